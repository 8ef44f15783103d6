"""`python -m robolamp`: the same as the `robolamp` command."""

from robolamp.cli.entry import main

main()
