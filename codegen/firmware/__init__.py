"""The firmware around an arm's controller: protocol, machine, boards, build files."""
