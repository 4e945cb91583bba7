"""Picks of several arms in one cell: their allocation, the common clock, and the result with its report and page."""
