"""``python -m pinproof``: the command line, for environments in which the command ``pinproof`` is not on the path."""

from pinproof.cli import main

if __name__ == "__main__":
    main()
