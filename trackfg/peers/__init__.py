"""Other packages' estimators on the same recordings, where they are installed: ``pip install "trackfg[peers]"``.

Each module wraps one of them as a baseline is: a recording in, a
:class:`~trackfg.baselines.result.BaselineResult` out, trackfg's axes and signs at the rim.
"""
