"""What a trajectory is executed on: boards, emulated or real, the link to them, and drives on a bus."""
