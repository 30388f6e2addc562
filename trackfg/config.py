"""The settings of the smoother are read from TOML; each has a unit and a default that suits a railway vehicle."""

from __future__ import annotations

import ast
import inspect
import json
import textwrap
from inspect import cleandoc
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from trackfg.files.small_file import WholeModel, read_model

Positive = Annotated[float, Field(strict=True, gt=0, le=1e9, allow_inf_nan=False)]
"""Above 1e9 in SI units nothing is distinguished any more, and squares of squares overflow."""
Length = Annotated[float, Field(strict=True, ge=1e-3, le=1e4)]
"""Of the track geometry's conventions, m: rails are not measured at less than a millimetre."""


def _no_shorter(value: float) -> float:
    if value < _SHORTEST_STEP:
        raise ValueError(f"expected at least {_SHORTEST_STEP:g}")
    return value


_SHORTEST_STEP = 1e-3
"""Of keyframes, s or m: no sensor has rows that are nearer."""
Step = Annotated[Positive, AfterValidator(_no_shorter)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class KeyframeConfig(_Section):
    """Keyframes follow each other by time or distance, whichever comes first, and by a longer time at rest."""

    interval_s: Step = 1.0
    """Longest time between keyframes in motion [s]."""
    distance_m: Step = 20.0
    """Longest distance between keyframes [m]."""
    interval_at_rest_s: Step = 5.0
    """Time between keyframes at rest [s]."""


class ImuConfig(_Section):
    """Holes in the IMU's record: over one, the body may turn and accelerate as if by white noise of these densities
    (rad/s and m/s^2 per sqrt(Hz)).
    """

    bridge_gyro_white: Positive = 0.05
    """How the body may turn over a gap of the IMU [rad/s/sqrt(Hz)]."""
    bridge_accel_white: Positive = 0.5
    """How it may accelerate over a gap of the IMU [m/s^2/sqrt(Hz)]."""


class TachConfig(_Section):
    """The wheel: creep (m per sqrt(m) rolled) and the part of it that goes with driving and braking (share of the
    distance per g of force), noise of a speed signal (m/s in 1 s; 0: as its rows show it), walk of the scale.

    What does not change during a run is estimated, with these prior sigmas: the mean creep in traction and that in
    braking (``creep_per_traction_sd``); how far to the left, and to the outside of curves, the wheel runs
    (``rail_offset_sd_m``).

    The tach's clock may be off by ``clock_offset_sd_s`` and drift by ``clock_drift_sd`` (s/s) against the IMU's.
    ``robust_width`` is where, in sigmas, a lone interval is as likely a slip; several in a row are earlier. Over a
    silence longer than ``max_gap_s`` (s), and than a few of the usual intervals, nothing is read off between its ends.
    """

    creep_m_per_sqrt_m: Positive = 1e-3
    """Random walk of the rolled distance [m/sqrt(m)]."""
    creep_per_traction: Positive = 0.05
    """Creep under driving and braking force, share of the distance: how it varies [1/g]."""
    creep_per_traction_sd: Positive = 0.05
    """Sigma of the mean of that creep over the run, in traction and in braking [1/g]."""
    rail_offset_sd_m: Positive = 0.1
    """Sigma of the place of the wheel beside the centre line, to the left and to the outside of curves [m]."""
    speed_noise_mps: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Noise of a speed signal; 0: as its rows show it, 0.1 in a stream [m/s in 1 s]."""
    scale_walk_per_sqrt_m: Positive = 1e-7
    """Random walk of the wheel scale [1/sqrt(m)]."""
    clock_offset_sd_s: Positive = 0.1
    """Sigma of the tach's clock offset [s]."""
    clock_drift_sd: Positive = 1e-4
    """Sigma of the tach's clock drift [s/s]."""
    robust_width: Annotated[float, Field(gt=2.5, allow_inf_nan=False)] = 3.5
    """Where a lone interval is as likely a slip [sigma]."""
    max_gap_s: Positive = 0.3
    """A longer silence of the tach in motion, if also longer than 3.5 of its usual intervals, is a gap: nothing is
    read off within it [s].
    """


class MotionConfig(_Section):
    """Sigmas of how the vehicle follows its own axis, and of how still it stands.

    Lateral and vertical velocity at the reference point: a constant part and one proportional to speed.
    ``mount_sd_deg`` is the uncertainty of the direction of travel in IMU axes (pitch, yaw). A sensor that is fixed to
    what follows the track (``[imu] rigid``) moves where it points all the way between two keyframes: to ``path_sd_m``
    and ``path_sd_relative`` times the distance. At rest it turns and shifts less from keyframe to keyframe than a body
    on springs.
    """

    lateral_sd_mps: Positive = 0.01
    """Lateral velocity of the reference point: constant part [m/s]."""
    vertical_sd_mps: Positive = 0.01
    """Vertical velocity: constant part [m/s]."""
    sd_per_speed: Positive = 1e-3
    """Lateral and vertical velocity: part in proportion to speed [1]."""
    robust_width: Positive = 3.0
    """Where lateral and vertical velocity and standstills begin to lose their weight [sigma]."""
    mount_sd_deg: Positive = 3.0
    """Sigma of the direction of travel in IMU axes, pitch and yaw [deg]."""
    path_sd_m: Positive = 2e-5
    """`rigid`: how far a path may leave the direction of travel between keyframes, constant part [m]."""
    path_sd_relative: Positive = 1e-5
    """`rigid`: the same, part in proportion to the distance between keyframes [1]."""
    rest_speed_sd_mps: Positive = 1e-3
    """Velocity at rest [m/s]."""
    rest_turn_sd_rad: Positive = 1e-4
    """Turn between keyframes at rest [rad]."""
    rest_shift_sd_m: Positive = 1e-3
    """Shift between keyframes at rest [m]."""
    rigid_rest_speed_sd_mps: Positive = 1e-5
    """Speed of a rigid sensor at rest [m/s]."""
    rigid_rest_turn_sd_rad: Positive = 1e-5
    """`rigid`: turn between keyframes at rest [rad]."""
    rigid_rest_shift_sd_m: Positive = 2e-5
    """`rigid`: shift between keyframes at rest [m]."""
    min_rest_s: Positive = 1.0
    """Shortest standstill that is looked for, less what is trimmed off its ends; 3 s at least without a tach [s]."""


class LaserConfig(_Section):
    """Displacement sensors: readings are means over ``window_s``; two units see one place of a rail alike to
    ``match_sd_m`` besides their own noise. Passes more than ``max_keyframes`` apart (a long stop between) are not tied.
    With lasers keyframes are placed at least as densely as ``keyframe_interval_s`` and ``keyframe_distance_m`` say,
    since the rails tie the motion at keyframes.
    """

    window_s: Positive = 0.06
    """Readings of displacement sensors are means over this [s]."""
    match_sd_m: Positive = 1e-5
    """How differently two units may see one place of a rail, besides their noise [m]."""
    robust_width: Positive = 4.0
    """Where a pair of sights begins to lose its weight [sigma]."""
    max_keyframes: Annotated[int, Field(gt=0)] = 32
    """Sights of one place this many keyframes apart are not tied [1]."""
    keyframe_interval_s: Step = 0.5
    """Longest time between keyframes where there are displacement sensors [s]."""
    keyframe_distance_m: Step = 5.0
    """Longest distance between keyframes where there are displacement sensors [m]."""


class PositionConfig(_Section):
    """GNSS and fixes: where, in sigmas, a position begins to lose its weight; never where ``robust`` is false.

    The receiver's clock may be off by ``gnss_clock_offset_sd_s`` against the IMU's. GNSS errors that last
    ``gnss_correlation_s`` (multipath: tens of seconds) are weighted as the independent ones that they amount to.
    """

    robust: bool = True
    """Whether fixes and GNSS positions may lose their weight at all."""
    gnss_width: Positive = 3.0
    """Where a GNSS position begins to lose its weight [sigma]."""
    fix_width: Positive = 4.0
    """Where a fix begins to lose its weight [sigma]."""
    gnss_clock_offset_sd_s: Positive = 0.3
    """Sigma of the receiver's clock offset [s]. Positions that are stamped on arrival are late by some tenths."""
    gnss_correlation_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """How long GNSS errors last (multipath: tens of seconds) [s]."""


class LineConfig(_Section):
    """A known line (``--line``): the sigma of its tracks across, and the length along it over which its errors change;
    where, in sigmas, it begins to lose its weight.

    The length is that of Infrabel's netelements around Brussels airport against its measuring train, twelve logs of
    2022-2024 in the repository Matdata-eu/tp-lib: the distances of 1336 fixed RTK positions from their track are
    correlated by 0.99 if 25 m apart, 0.90 at 200 m, 0.84 at 800 m and 0.78 at 1600 m. They are 1.3 m in the median and
    1.75 m rms, with what antenna and datum add; the default is a line of which these are known.
    """

    sd_m: Positive = 1.0
    """Sigma of a known line's tracks across [m]."""
    correlation_m: Positive = 5000.0
    """Length along it over which its errors change [m]."""
    robust_width: Positive = 3.0
    """Where a known line begins to lose its weight [sigma]."""


class NoiseConfig(_Section):
    """Factors on the assumed sigmas: of the gyro's and the accelerometer's declared white noise, of the vehicle's
    sideways motion at an instant and along the path, of the wheel's rolling, of GNSS positions.

    ``adapt`` raises them to what the residuals show. Whatever a solution contradicts, the run is solved again at most
    ``rounds`` times.
    """

    adapt: bool = True
    """Raise the noise levels to what the residuals show, and solve again."""
    rounds: Annotated[int, Field(gt=0)] = 3
    """How many times at most a run is solved again [1]."""
    gyro: Positive = 1.0
    """Factor on the gyro's declared white noise (vibration, aliasing) [1]."""
    accel: Positive = 1.0
    """Factor on the accelerometer's declared white noise [1]."""
    motion: Positive = 1.0
    """Factor on the sigmas of lateral and vertical velocity [1]."""
    path: Positive = 1.0
    """Factor on the sigma of the path between keyframes [1]."""
    tach: Positive = 1.0
    """Factor on the sigma of the rolled distance [1]."""
    gnss: Positive = 1.0
    """Factor on the sigmas of GNSS positions [1]."""

    def factors(self) -> dict[str, float]:
        """Return the factor of each group."""
        return {name: getattr(self, name) for name in ("gyro", "accel", "motion", "path", "tach", "gnss")}


class OutputConfig(_Section):
    """The trajectory's rate."""

    rate_hz: Annotated[float, Field(strict=True, gt=0, le=1e4)] = 10.0
    """Rate of the trajectory [Hz]."""


class GeometryConfig(_Section):
    """The meaning of the columns of the geometry table, m: grid, base of the twist and where it lies from the place
    that the twist is written at, length of the chord of the versines, wavelengths that level and alignment hold (the
    band D1), bases of curvature and gradient.

    Bases and half the chord are whole multiples of the grid's step; half the base of a centred twist is, too.
    """

    step_m: Length = 0.25
    """Step of the geometry table along the chainage [m]."""
    twist_base_m: Length = 5.0
    """Base of the twist [m]."""
    twist_anchor: Literal["behind", "centre", "ahead"] = "behind"
    """Where the base lies from the place that the twist is written at: `behind`, `centre`, `ahead`."""
    chord_m: Length = 10.0
    """Chord of the versines [m]."""
    band_m: tuple[Length, Length] = (3.0, 25.0)
    """Shortest and longest wavelength of level and alignment [m]."""
    curvature_base_m: Length = 10.0
    """Base of the curvature [m]."""
    gradient_base_m: Length = 25.0
    """Base of the gradient [m]."""

    @model_validator(mode="after")
    def _fits_the_grid(self) -> GeometryConfig:
        halves = {name: getattr(self, name) / 2 for name in ("chord_m", "curvature_base_m", "gradient_base_m")}
        whole = "" if self.twist_anchor == "centre" else "twist_base_m"
        twist_m = self.twist_base_m if whole else self.twist_base_m / 2
        for name, length in {"twist_base_m": twist_m, **halves}.items():
            steps = length / self.step_m
            if abs(steps - round(steps)) > 1e-9 * steps or round(steps) == 0:
                what = "" if name == whole else "half of "
                raise ValueError(
                    f"{what}{name} is {length:g} m: expected a whole multiple of step_m, {self.step_m:g} m"
                )
        if self.band_m[0] >= self.band_m[1] or self.band_m[0] <= 2 * self.step_m:
            raise ValueError(f"band_m {self.band_m}: expected (shortest, longest), the shortest above twice step_m")
        return self


class SolverConfig(_Section):
    """The solver stops at a step below ``step_tolerance`` posterior sigmas in every direction, a step that lowers the
    cost by less than ``cost_tolerance``, or ``max_iterations``.
    """

    step_tolerance: Positive = 0.03
    """Stop at a step shorter than this [sigma]."""
    cost_tolerance: Positive = 0.02
    """Stop at a step that lowers the cost by less, once robust losses apply [1]."""
    max_iterations: Annotated[int, Field(gt=0)] = 50
    """Stop without having converged [1]."""


class SmoothConfig(WholeModel, _Section):
    """All settings of ``trackfg smooth``. Every section may be left out.

    Examples
    --------
    >>> import trackfg
    >>> config = trackfg.SmoothConfig.model_validate({"output": {"rate_hz": 50.0}})
    >>> config.output.rate_hz, config.keyframes.interval_s  # Hz, s
    (50.0, 1.0)
    """

    keyframes: KeyframeConfig = KeyframeConfig()
    imu: ImuConfig = ImuConfig()
    tach: TachConfig = TachConfig()
    motion: MotionConfig = MotionConfig()
    laser: LaserConfig = LaserConfig()
    position: PositionConfig = PositionConfig()
    line: LineConfig = LineConfig()
    noise: NoiseConfig = NoiseConfig()
    output: OutputConfig = OutputConfig()
    geometry: GeometryConfig = GeometryConfig()
    solver: SolverConfig = SolverConfig()

    @classmethod
    def from_toml(cls, path: str | Path) -> SmoothConfig:
        """Read a configuration file. Raises ``BadInputError`` that names the file, the key and what was expected."""
        return read_model(Path(path), cls)

    @classmethod
    def template(cls) -> str:
        """Return a configuration file with every default, and above each what it means and its unit."""
        sections = []
        for name, section in cls.model_fields.items():
            kind = type(section.default)
            values, meaning = section.default.model_dump(mode="json"), _attribute_docstrings(kind)
            lines = [f"# {text}" for text in _paragraph(kind.__doc__ or "")] + [f"[{name}]"]
            for key in kind.model_fields:
                lines += [f"# {text}" for text in _paragraph(meaning[key])]
                lines.append(f"{key} = {json.dumps(values[key])}")
            sections.append("\n".join(lines))
        return "\n\n".join(sections) + "\n"


def _attribute_docstrings(kind: type) -> dict[str, str]:
    """Return what stands below each attribute of a class: read when it is wanted, since pydantic takes 40 ms for it."""
    definition = ast.parse(inspect.getsource(kind)).body[0]
    assert isinstance(definition, ast.ClassDef)
    texts = {}
    for attribute, below in pairwise(definition.body):
        if isinstance(attribute, ast.AnnAssign) and isinstance(below, ast.Expr):
            texts[ast.unparse(attribute.target)] = ast.literal_eval(below.value)
    return texts


def _paragraph(text: str) -> list[str]:
    """Return the first paragraph of a docstring in lines of 100 letters."""
    return textwrap.wrap(cleandoc(text).split("\n\n")[0], 100)
