"""The verifier of pages, in JavaScript, against the one in Python: proofs that hold, and corrupted ones."""

import copy
import json
import re
import shutil
import subprocess
from collections import Counter
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from pinproof.verifier import load, verify

from .forging import FORGERIES, Samples, forged, pick, small_proofs
from .test_tampering import TAMPERINGS

VIEWER = Path(__file__).parents[2] / "src" / "pinproof" / "viewer"

DRIVER = """
const fs = require("fs"), [file, viewer] = process.argv.slice(1);
const verifier = new Function(fs.readFileSync(viewer + "/verifier.js", "utf8") + "; return ProofVerifier;")();
(async () => {
  const verdicts = [];
  for (const line of fs.readFileSync(file, "utf8").split("\\n").filter(Boolean)) {
    try { verdicts.push(await verifier.verify(verifier.read(line))); }
    catch (error) {
      if (!(error instanceof SyntaxError)) throw error;  // NaN and Infinity are no JSON
      verdicts.push({ ok: false, reason: "proof: " + error.message });
    }
  }
  console.log(JSON.stringify(verdicts));
})();
"""


def in_javascript(documents, folder):
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    texts = [each if isinstance(each, str) else json.dumps(each) for each in documents]
    (folder / "proofs").write_text("\n".join(texts), encoding="utf-8")
    words = [node, "-e", DRIVER, folder / "proofs", VIEWER]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def in_python(document):
    """The verdict on the document as JavaScript reads it, which does not tell 1.0 from 1."""

    def number(text):
        value = float(text)
        whole = value.is_integer() and abs(value) < 2**53 and (value != 0.0 or not text.startswith("-"))
        return int(value) if whole else value

    def refuse(text):
        raise ValueError(text)

    try:
        return verify(json.loads(json.dumps(document), parse_float=number, parse_constant=refuse))
    except ValueError:
        return None


def agree(documents, folder):
    """Equal verdicts and clearances, and refused for the same part of the file; the number that holds."""
    held = 0
    for document, found in zip(documents, in_javascript(documents, folder), strict=True):
        expected = in_python(document)
        assert found["ok"] == (expected is not None and expected.ok), (found["reason"], str(expected))
        if found["ok"]:
            clearance = np.inf if found["clearance"] is None else found["clearance"]
            assert clearance >= expected.clearance - 1e-8
            if clearance > expected.clearance + 1e-8:  # numbers of 100 km, whose errors Python bounds together
                assert Samples(document).violation(clearance - 1e-6) is None
            assert (found["pairs"], found["intervals"]) == (expected.pairs, expected.intervals)
            assert tuple(found["limits"]) == expected.limits
        elif expected is not None:
            same = re.match(r"\w+", found["reason"])[0] == re.match(r"\w+", expected.reasons[0])[0]
            assert same, (found["reason"], expected.reasons)
        held += found["ok"]
    return held


@pytest.fixture(scope="module")
def proofs():
    return list(small_proofs())


def test_proofs_of_every_shape_hold_in_javascript_too(proofs, tmp_path):
    assert agree(proofs, tmp_path) == len(proofs)


def test_each_tampering_is_refused_in_javascript_too(proof, rehashed, tmp_path):
    documents = []
    for apply, _ in TAMPERINGS.values():
        documents.append(copy.deepcopy(proof))
        apply(documents[-1])
        documents[-1] = rehashed(documents[-1])
        documents.append(copy.deepcopy(proof))  # by accident, with the old hashes
        apply(documents[-1])
    for key in proof:
        for value in (None, [], {}, "x", 7, [[]], [None], [{}]):
            documents.append({**proof, key: value})
        documents.append({name: part for name, part in proof.items() if name != key})
    assert len(documents) > 190
    agree(documents, tmp_path)
    assert not any(found["ok"] for found in in_javascript(documents[: 2 * len(TAMPERINGS)], tmp_path))


def test_limits_that_a_motion_exceeds_are_refused_in_javascript_too(proof, tmp_path):
    documents = []
    for key, sign in (("lower", -1.0), ("upper", 1.0), ("velocity", 1.0), ("acceleration", 1.0)):
        for value in (0.0, 0.3, 0.79, 0.81, 1.19, 1.21, 2.0, None):
            limits = {"lower": [-1.0] * 3, "upper": [1.5] * 3, "velocity": [9.0] * 3, "acceleration": [None] * 3}
            limits[key] = [None if value is None else sign * value] * 3
            documents.append({**proof, "limits": limits})
    held = agree(documents, tmp_path)
    assert 3 < held < len(documents) - 3


def test_random_forgeries_have_the_same_verdict_in_javascript(proofs, tmp_path):
    """Of every kind of the tests of the verifier; their hashes are right."""
    rng, documents, kinds = np.random.default_rng(38), [], Counter()
    while len(documents) < 260:
        document, changes = forged(pick(rng, proofs[:-1] if rng.random() < 0.9 else proofs), rng)
        if document is not None:
            documents.append(document)
            kinds.update(changes)
    assert set(kinds) == {kind.__name__ for kind in FORGERIES}
    held = agree(documents, tmp_path)
    assert 30 < held < 200


def test_a_repeated_key_is_refused_in_javascript_too(proof, tmp_path):
    text = json.dumps(proof)
    keys = sorted(set(re.findall(r'"(\w+)": ', text)))
    repeated = [re.sub(rf'("{key}": )', r"\1null, \1", text, count=1) for key in keys]
    repeated += [text[:-1] + r', "cl\u0061im": ' + json.dumps(proof["claim"]) + "}"]  # the same key, escaped
    names = {**proof, "robot": 'a key: "claim": {"x": 1}, \\'}  # no key, inside a text
    found = in_javascript([*repeated, text, names], tmp_path)
    for name, verdict in zip([*repeated, text, names], found, strict=True):
        (tmp_path / "proof.json").write_text(name if isinstance(name, str) else json.dumps(name), encoding="utf-8")
        with nullcontext() if name in (text, names) else pytest.raises(ValueError, match="repeated"):
            load(tmp_path / "proof.json")
        assert ("a key is repeated" in verdict["reason"]) == (name not in (text, names))
    assert found[-2]["ok"]
