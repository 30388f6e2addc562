"""The version of trackfg, in one place that needs no import of the rest."""

__version__ = "0.1.0"
