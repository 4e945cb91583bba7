"""``python -m pinproof.verifier proof.json``: exit code 0 if the proof holds, 1 if not, 2 if it cannot be read."""

from __future__ import annotations

import sys

from .parts import load
from .proof import verify


def main(words: list[str]) -> int:
    """Verify one file and print the verdict, with the pairs that the proof does not cover."""
    if len(words) != 1:
        sys.stderr.write("usage: python -m pinproof.verifier PROOF.json[.gz]\n")
        return 2
    try:
        document = load(words[0])
    except (OSError, ValueError) as error:
        sys.stderr.write(f"{words[0]}: {error}\n")
        return 2
    verdict = verify(document)
    lines = [str(verdict), *(f"not checked: {a} and {b} ({reason})" for a, b, reason in verdict.excluded)]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0 if verdict.ok else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
