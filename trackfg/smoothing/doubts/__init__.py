"""Doubts are what residuals, motion and recording of a run say against its sigmas; ``judgement`` collects them."""
