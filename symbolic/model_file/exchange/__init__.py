"""Arms of other programs: URDF and MJCF in and out."""
