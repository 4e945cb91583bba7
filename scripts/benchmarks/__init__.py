"""Benchmarks with other libraries, problem sets and the tables of the manual; see ``./scripts/benchmark --help``."""
