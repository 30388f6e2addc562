"""Effects that make a simulated run as rough as a real one, each a small object with a magnitude.

:func:`trackfg.datasets.effects.catalogue.effect` makes one by name; a scenario has them in ``effects``. See
docs/datasets.md.
"""
