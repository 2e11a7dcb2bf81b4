"""What lets other programs use the generated C: a C++ header, a CMake package and a Python module."""
