"""Helpers that several packages share: files, YAML with line numbers, validation, content hashes."""

__all__: list[str] = []
