"""Base placement: the search in a region, screening, proofs, bounds, and the result with its heat map."""
