"""`python -m robolamp`: the same as the `robolamp` command."""

from robolamp.cli.main import main

main()
