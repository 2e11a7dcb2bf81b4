"""What is in a recording, and what looks wrong about it, before anything is concluded from it."""
