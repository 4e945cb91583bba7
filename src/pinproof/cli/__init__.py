"""The command line: parse, call, print."""

from pinproof.cli.main import main

__all__ = ["main"]
