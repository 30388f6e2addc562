"""VQF's offline attitude filter: Laidig and Seel, "VQF: highly accurate IMU orientation estimation with bias estimation
and magnetic disturbance rejection", Information Fusion 91 (2023); its own C++ behind the package ``vqf``.

It runs over the whole record in both directions: the gyro is integrated, the specific force turned into those axes and
low-passed without delay (Butterworth, second order, tau_acc), and what then is not vertical tilts the attitude. It
estimates the gyro's bias in motion and where it takes the sensor to be at rest. Its Earth frame has z up and any
heading, and its quaternion takes FLU there: its roll and pitch are trackfg's, nothing is converted.

VQF knows no vehicle: it is given the specific force less the wheel's acceleration ``dv/dt`` forwards and ``w x v``;
``compensated=False`` is VQF as it comes. It has no sigma of its angles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from trackfg.baselines.attitude import Attitude, motion_of, tables
from trackfg.errors import BadInputError
from trackfg.geometry.cross_level import cross_level
from trackfg.numerics.rotations import rpy_from_matrix
from trackfg.peers.installed import require

if TYPE_CHECKING:
    from trackfg.baselines.result import BaselineResult
    from trackfg.recording.model import Recording

NAME = "vqf"


def run(
    recording: Recording, *, tau_acc_s: float = 3.0, remove_static_bias: bool = True, compensated: bool = True
) -> BaselineResult:
    """Estimate roll, pitch, cross-level and twist of a recording, by VQF's own defaults but for tau_acc.

    ``remove_static_bias``: the gyro's, from the standstill at the start, before VQF looks for what is left of it.
    Raises :class:`~trackfg.errors.MissingLibraryError` without the package, ``BadInputError`` without a
    tachometer and for a tau_acc that is not above 0.
    """
    require("vqf")
    from vqf import offlineVQF

    if not 0.0 < tau_acc_s < np.inf:
        raise BadInputError(f"tau_acc_s is {tau_acc_s!r}; expected a time above 0")
    motion = motion_of(recording, remove_static_bias=remove_static_bias)
    force = motion.accel
    if compensated:
        force = motion.without_centripetal()
        force[:, 0] -= np.gradient(motion.speed, motion.t)
    out = offlineVQF(
        np.ascontiguousarray(motion.gyro),
        np.ascontiguousarray(force),
        None,  # no magnetometer
        motion.sampling_s,
        {"tauAcc": tau_acc_s},
    )
    rpy = rpy_from_matrix(Rotation.from_quat(out["quat6D"], scalar_first=True).as_matrix())
    base = recording.description.track.cross_level_base_m
    attitude = Attitude(roll=rpy[:, 0], cross_level=cross_level(rpy[:, 0], base), pitch=rpy[:, 1])
    parameters: dict[str, float | str | bool] = {
        "tau_acc_s": tau_acc_s,
        "remove_static_bias": remove_static_bias,
        "compensated": compensated,
    }
    return tables(NAME, recording, motion, attitude, parameters)
