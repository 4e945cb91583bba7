"""Re-checks saved proofs with NumPy alone: other code than made them, short enough to be read, free to be copied.

Nothing here imports the rest of pinproof, so that a robot cell can trust a proof without trusting what made it:
``python -m pinproof.verifier proof.json``, or a copy of this folder anywhere and ``python -m verifier proof.json``.
The file format is described in docs/certificates.md.
"""

from .proof import Proof, ProofVerdict, verify
from .reading import FORMAT, VERSION, Refused, body_digest, curve_digest, load
from .stretches import Stretches

__all__ = [
    "FORMAT",
    "VERSION",
    "Proof",
    "ProofVerdict",
    "Refused",
    "Stretches",
    "body_digest",
    "curve_digest",
    "load",
    "verify",
]
