"""Results on the terminal, from the same dictionaries that --json writes."""
