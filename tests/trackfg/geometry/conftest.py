"""The response of an operator, measured: what it makes of a wave, over the wave."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest


@pytest.fixture(scope="session")
def measured_response() -> Callable[..., np.ndarray]:
    """``measured_response(operator, wavelength_m, step_m, length_m)``: the ratio at every place where there is
    output."""

    def measure(
        operator: Callable[[np.ndarray], np.ndarray], wavelength_m: float, step_m: float = 0.25, length_m: float = 400.0
    ) -> np.ndarray:
        x = np.arange(round(length_m / step_m) + 1) * step_m
        phase = 2.0 * np.pi * x / wavelength_m
        cosine, sine = operator(np.stack([np.cos(phase), np.sin(phase)]))
        known = np.isfinite(cosine)
        assert known.any()
        return np.asarray(((cosine + 1j * sine) / np.exp(1j * phase))[known])

    return measure
