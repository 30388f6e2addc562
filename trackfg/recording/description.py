"""``recording.toml`` as typed, validated models: format ``trackfg-recording/1``.

Field names, units and defaults are the contract's. Unknown keys are refused, so that a misspelt one is not ignored.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from trackfg.files.small_file import WholeModel
from trackfg.numerics import rotations
from trackfg.recording.line_kilometrage import LineKilometrage
from trackfg.recording.strict_model import Model

Name = Annotated[str, Field(pattern=r"^[^\x00]*$", max_length=1000)]
"""Of a recording or a sensor: databases store no null character."""
Vector3 = tuple[float, float, float]
Flag = Annotated[bool, Field(strict=True)]
Latitude = Annotated[float, Field(strict=True, ge=-90, le=90)]
Longitude = Annotated[float, Field(strict=True, ge=-180, le=360)]
Height = Annotated[float, Field(strict=True, ge=-1e7, le=1e7)]
"""m. Here as below, a number is refused that no railway, vehicle or sensor has, in the wrong unit or not: bounds are
orders of magnitude away from what there is, and exclude what would overflow in the equations."""
Seconds = Annotated[float, Field(strict=True, ge=-1e10, le=1e10)]
"""An offset of a clock, s: 300 years."""
Length = Annotated[float, Field(strict=True, ge=1e-3, le=1e4)]
"""Of a vehicle's or a track's part, m; also in mm, which the checks then report."""
Place = Annotated[float, Field(strict=True, ge=-100, le=100)]
"""On a vehicle, from its reference point, m: a car is 20 to 30 m long."""
Angle = Annotated[float, Field(strict=True, ge=-720, le=720)]
"""deg."""
Pulses = Annotated[float, Field(strict=True, ge=1e-3, le=1e7)]
"""Per revolution: encoders have 1 to 10,000, and a gear may be between."""
Sd = Annotated[float, Field(strict=True, ge=1e-12, le=1e3)]
"""A sigma or a density in SI units."""
Share = Annotated[float, Field(strict=True, ge=1e-12, le=10)]
"""A sigma of a factor about 1, or of a small angle in rad."""
SdDegrees = Annotated[float, Field(strict=True, ge=1e-9, le=180)]
MOST_OF_A_KIND = 100
"""Sensors of one kind: measuring trains have a dozen lasers."""
_MOST_TRACKS = 100_000
"""Tracks that a run takes: those of a country."""
TimeUnit = Literal["s", "ms", "us", "ns"]


def _three_columns(names: tuple[str, str, str]) -> tuple[str, str, str]:
    if len(set(names)) < len(names):
        raise ValueError(f"is {list(names)}, one column twice: expected three different columns")
    return names


ThreeColumns = Annotated[tuple[str, str, str], AfterValidator(_three_columns)]


class Table(Model):
    """A table's file, its time column, and how that becomes seconds on the recording's clock."""

    file: str
    time: str = "t"
    time_unit: TimeUnit = "s"
    time_offset_s: Seconds = 0.0

    @property
    def files(self) -> tuple[str, ...]:
        """The names of the files that it is read from."""
        return (self.file,)


WIDEST_HEAD_M = 0.1
"""No rail has a wider head; the common ones have 0.06 to 0.08 m."""


def rail_head_m(gauge_m: float, cross_level_base_m: float) -> float:
    """Return how much further apart the middles of the rails' tops are than their running edges, m: a head's width.

    Cross-level refers to the distance of the tops where that is wider than the gauge by a head at most. Where it is
    not, as with 1.067 m for both, tops and edges count as equally far apart.
    """
    wider = cross_level_base_m - gauge_m
    return wider if 0.0 < wider <= WIDEST_HEAD_M else 0.0


class Track(Model):
    """The line and the run on it.

    ``latitude_deg`` is needed to model Earth rotation; ``heading_deg`` (clockwise from north, at the start of the run)
    lets its horizontal part be modelled where no GNSS gives the heading.
    """

    gauge_m: Length = 1.435
    cross_level_base_m: Length = 1.5
    direction: Literal[1, -1] = 1
    latitude_deg: Latitude | None = None
    heading_deg: Angle | None = None

    @property
    def head_m(self) -> float:
        """Return the width of a rail's head, m (:func:`rail_head_m`)."""
        return rail_head_m(self.gauge_m, self.cross_level_base_m)


class ImuNoise(Model):
    """Continuous-time densities, sigmas of initial biases, and how well the sensor is calibrated: scale factors, axes
    (what one senses of another's input), what the gyro senses of accelerations, the accelerometer's bias per power of
    vibration. SI (see the recording format).
    """

    gyro_white: Sd = 1e-4
    accel_white: Sd = 2e-3
    gyro_bias_walk: Sd = 2e-6
    accel_bias_walk: Sd = 1e-5
    gyro_bias_sd: Sd = 1e-3
    accel_bias_sd: Sd = 0.03
    gyro_scale_sd: Share = 1e-3
    accel_scale_sd: Share = 1e-3
    misalignment_sd_rad: Share = 6e-4
    g_sensitivity_sd: Share = 2e-5
    rectification_sd: Share = 5e-4


TAPE_SD_M = (0.05, 0.02, 0.05)
"""1-sigma of a lever arm, m: it was measured with a tape, sideways from the middle of the vehicle."""

ON_SPRINGS_SD_M = (1.0, 0.02, 1.0)
"""1-sigma of one in a body on springs, m: what follows the track is where the body's roll and pitch have
their poles, at the height of the springs and not of the rails."""


ANYWHERE_ACROSS_SD_M = 0.5
"""1-sigma across the vehicle where no lever arm is declared, m: cars are 2.6 to 3 m wide. Along and up a sensor that is
elsewhere swings sideways and up as the vehicle turns, which contradicts the prior; across it only moves further or less
far in curves, as a wheel on the outer rail does."""


class Imu(Table):
    """The inertial sensor: columns, units, axes, mounting and noise.

    ``id`` names the sensor in its mounting: recordings with one ``id`` share what is not known of the mounting.
    ``rigid``: it is fixed to what follows the track (trolley, axle box, wheelset), and not on springs (bogie frame, car
    body). ``mount_roll_sd_deg``: how well the roll in ``mount_rpy_deg`` is known, which no measurement shows.
    ``lever_arm_sd_m``: how well ``lever_arm_m`` says where the sensor is from the point of the vehicle that follows the
    track; by default to :data:`TAPE_SD_M`, on springs :data:`ON_SPRINGS_SD_M`, across to :data:`ANYWHERE_ACROSS_SD_M`
    where none is declared. A sensor elsewhere contradicts that, and the smoother widens it then.
    """

    id: Annotated[Name, Field(min_length=1)] | None = None
    stamp: Literal["start", "centre", "end"] = "centre"
    gyro: ThreeColumns
    gyro_unit: Literal["rad/s", "deg/s"] = "rad/s"
    accel: ThreeColumns
    accel_unit: Literal["m/s^2", "g"] = "m/s^2"
    axes: str = "FLU"
    rigid: Flag = True
    mount_rpy_deg: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    mount_roll_sd_deg: Annotated[float, Field(strict=True, ge=0, le=180)] = 0.0
    lever_arm_m: tuple[Place, Place, Place] = (0.0, 0.0, 0.0)
    lever_arm_sd_m: tuple[Sd, Sd, Sd] | None = None
    noise: ImuNoise = ImuNoise()

    @property
    def lever_arm_sigma_m(self) -> Vector3:
        """The 1-sigma of the lever arm as it is declared, or else by default, m."""
        if self.lever_arm_sd_m is not None:
            return self.lever_arm_sd_m
        along, across, up = TAPE_SD_M if self.rigid else ON_SPRINGS_SD_M
        return along, across if any(self.lever_arm_m) else ANYWHERE_ACROSS_SD_M, up

    @field_validator("axes")
    @classmethod
    def _axes_are_a_triad(cls, value: str) -> str:
        rotations.axes_matrix(value)
        return value


class Tach(Table):
    """The wheel tachometer. ``kind`` says what ``column`` holds; ``pulses`` needs the wheel and the pulse count.

    ``integrated`` marks a distance that was integrated from a speed: it is not made of counts, and its error grows.
    """

    column: str
    kind: Literal["pulses", "distance", "speed"]
    unit: Literal["1", "m", "mm", "m/s", "km/h"] = "1"
    pulses_per_rev: Pulses | None = None
    wheel_diameter_m: Length | None = None
    scale_sd: Share = 0.01
    signed: Flag = False
    integrated: Flag = False

    @property
    def integrates_speed(self) -> bool:
        """Return whether the distance in the ``tach`` table was integrated from a speed, here or before."""
        return self.kind == "speed" or self.integrated

    @model_validator(mode="after")
    def _kind_and_unit_agree(self) -> Tach:
        allowed = {"pulses": ("1",), "distance": ("m", "mm"), "speed": ("m/s", "km/h")}[self.kind]
        if self.unit not in allowed:
            raise ValueError(f"unit {self.unit!r} does not fit kind {self.kind!r}: expected {' or '.join(allowed)}")
        if self.kind == "pulses" and (self.pulses_per_rev is None or self.wheel_diameter_m is None):
            raise ValueError("kind 'pulses' needs pulses_per_rev and wheel_diameter_m")
        return self


class FurtherTach(Tach):
    """A tachometer on a further axle, with its own wheel, clock and slips."""


class Fixes(Table):
    """Absolute chainages: balise, RFID, mile post."""

    chainage: str = "chainage_m"
    sd: str = "sd_m"


class Balises(Table):
    """Balises, RFID tags and posts with an id: which one was passed when, and where each is planned to be.

    The table ``file`` has one row for each passage, ``id`` names its column of ids. The table ``places`` has a row for
    each of them; by default the chainages are columns of ``file``, if it has any.
    """

    id: str = "id"
    places: str | None = None
    chainage: str = "chainage_m"
    sd: str = "sd_m"
    reading_sd_m: Sd = 0.1

    @property
    def files(self) -> tuple[str, ...]:
        """The names of the tables of passages and of places."""
        return (self.file,) if self.places is None else (self.file, self.places)


RECEIVER_SPEED_SD_MPS = 0.1
"""1-sigma of a receiver's speed where nothing is declared, m/s: a geodetic one in streets errs by 0.073 m/s or less in
68 % of rows (Kingston, `tools/real_data_facts.py`), a u-blox NEO-M8 by 0.05 m/s or less in 50 % (its data sheet)."""


class Gnss(Table):
    """Satellite positions: latitude, longitude, height (``frame = "geodetic"``) or east, north, up (``"local"``).

    ``origin`` (latitude deg, longitude deg, height m) is where the ENU frame touches the ellipsoid. Geodetic positions
    default to the first row; for local ones it is optional and says where on the Earth they are.
    """

    position: ThreeColumns
    sd: tuple[str, str, str]
    frame: Literal["geodetic", "local"] = "geodetic"
    origin: tuple[Latitude, Longitude, Height] | None = None
    lever_arm_m: tuple[Place, Place, Place] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class UnplacedAntenna:
    """An antenna of which is not known where it is from the inertial sensor: to a sigma ahead and to the left, m."""

    sd_m: tuple[float, float]


class GnssSpeed(Table):
    """Speeds over ground of the satellite receiver, from Doppler shifts: a magnitude, of the antenna of ``[gnss]``.

    ``sd`` is the column of their sigmas, in the same unit; without it all have ``sd_mps``, by default
    :data:`RECEIVER_SPEED_SD_MPS`. Where the receiver gives none, rows are missing or empty. Its time has an offset of
    its own: a receiver filters speeds, and they are later than its positions.
    """

    column: str
    unit: Literal["m/s", "km/h"] = "m/s"
    sd: str | None = None
    sd_mps: Sd = RECEIVER_SPEED_SD_MPS


class Speed(Table):
    """A sensor of the speed over ground: a Doppler radar, or an optical one. It looks forwards.

    ``sd_mps`` is the noise of a row, ``scale_sd`` that of the scale, ``yaw_sd_deg`` that of the direction in which it
    looks. Below ``lowest_mps`` it says nothing; where it has no echo, rows are missing or empty.
    """

    column: str
    unit: Literal["m/s", "km/h"] = "m/s"
    sd_mps: Sd = 0.05
    scale_sd: Share = 0.01
    yaw_sd_deg: SdDegrees = 0.5
    lowest_mps: Annotated[float, Field(strict=True, ge=0, le=200)] = 0.0
    signed: Flag = False
    lever_arm_m: tuple[Place, Place, Place] = (0.0, 0.0, 0.0)


class Laser(Table):
    """A displacement sensor: where one rail is relative to the unit, along one body axis."""

    name: str
    column: str
    unit: Literal["m", "mm"] = "m"
    position_m: tuple[Place, Place, Place]
    axis: Literal["y", "z"]
    rail: Literal["left", "right"]
    sd_m: Sd


class KnownLineFile(Model):
    """Tracks that the run may be on: a GeoJSON file or a GeoPackage in the recording's folder (docs/known-line.md).

    ``path`` are the ids of those that it takes; without any, all. ``crs`` is the reference system of the coordinates
    (``"EPSG:3067"``, ``"local"``), instead of the file's own.
    """

    file: str
    path: Annotated[tuple[str, ...], Field(max_length=_MOST_TRACKS)] = ()
    crs: str | None = None

    @property
    def files(self) -> tuple[str, ...]:
        """The names of the files that it is read from."""
        return (self.file,)


class Truth(Table):
    """The answer, where it is known. Only comparisons may open it."""

    geometry: str | None = None

    @property
    def files(self) -> tuple[str, ...]:
        """The names of the tables of the trajectory and of the geometry."""
        return tuple(filter(None, (self.file, self.geometry)))


class RecordingDescription(WholeModel, Model):
    """All of ``recording.toml``. Of a list ``[[tach]]`` the first is ``tach``, the others are ``further_tach``."""

    format: Literal["trackfg-recording/1"] = "trackfg-recording/1"
    id: Name
    start: datetime | None = None
    track: Track = Track()
    kilometrage: LineKilometrage | None = None
    imu: Imu
    tach: Tach | None = None
    further_tach: Annotated[tuple[FurtherTach, ...], Field(max_length=MOST_OF_A_KIND)] = ()
    fixes: Fixes | None = None
    balises: Balises | None = None
    gnss: Gnss | None = None
    gnss_speed: GnssSpeed | None = None
    speed: Annotated[tuple[Speed, ...], Field(max_length=MOST_OF_A_KIND)] = ()
    laser: Annotated[tuple[Laser, ...], Field(max_length=MOST_OF_A_KIND)] = ()
    known_line: KnownLineFile | None = None
    truth: Truth | None = None

    @property
    def unplaced_antenna(self) -> UnplacedAntenna | None:
        """The antenna, where its place is declared and that of the inertial sensor is not.

        Declared from the reference point, it is elsewhere from the sensor by as much as the sensor is from there;
        declared from the sensor, it is where it is said to be.
        """
        if self.gnss is None or "lever_arm_m" not in self.gnss.model_fields_set:
            return None
        if "lever_arm_m" in self.imu.model_fields_set:
            return None
        along, across, _ = self.imu.lever_arm_sigma_m
        return UnplacedAntenna((along, across))

    @model_validator(mode="after")
    def _counts_no_passage_twice(self) -> RecordingDescription:
        if self.fixes is not None and self.balises is not None and self.fixes.file == self.balises.file:
            raise ValueError(
                f"[fixes] and [balises] are both read from {self.fixes.file}, so that every passage would count twice: "
                "expected one of them"
            )
        return self

    @model_validator(mode="after")
    def _finds_its_tracks(self) -> RecordingDescription:
        if self.known_line is not None and self.gnss is None:
            raise ValueError("[known_line] without [gnss]: expected positions, by which its tracks are found")
        return self

    @field_validator("laser")
    @classmethod
    def _laser_names_differ(cls, value: tuple[Laser, ...]) -> tuple[Laser, ...]:
        names = [laser.name for laser in value]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two lasers have the name {name!r}: expected a different one each")
        sights = [(laser.position_m[0], laser.axis, laser.rail) for laser in value]
        for laser, (along, axis, rail) in zip(value, sights, strict=True):
            if sights.count((along, axis, rail)) > 1:
                raise ValueError(
                    f"laser {laser.name!r}: another one at x = {along:g} m measures the {rail} rail along {axis} too; "
                    "expected one of each"
                )
        return value
