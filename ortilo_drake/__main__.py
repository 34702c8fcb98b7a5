"""`python -m ortilo_drake` is the command `ortilo`."""

from ortilo_drake.cli import main

if __name__ == "__main__":
    main()
