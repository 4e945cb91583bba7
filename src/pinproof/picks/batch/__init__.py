"""Many picks: validation in memory, campaigns on disk, fast screening, and reach maps."""
