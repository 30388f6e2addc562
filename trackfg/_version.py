"""The version of trackfg, in one place that needs no import of the rest."""

__version__ = "0.2.0"
