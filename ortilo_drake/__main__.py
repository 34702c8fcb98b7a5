"""`python -m ortilo_drake` is `ortilo`."""

from ortilo_drake.cli import main

main()
