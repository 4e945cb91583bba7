"""Certificates of motions: proofs between samples, constraints of the tool, robot programs, proof files and reuse."""
