"""The judgement of one pick: its stages, the search for the best motion, the verdict and the suggestions."""
