"""`python -m tendon` is the command line."""

from runtime.cli.main import main

main()
