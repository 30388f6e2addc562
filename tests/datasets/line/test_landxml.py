"""LandXML files written here are read back to their analytic coordinates; bad ones give one clear error each."""

import re
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from trackfg.datasets.line.landxml import read_landxml, read_plans
from trackfg.errors import BadInputError

SHAPES = {
    "clothoid": lambda u: u,
    "cosine": lambda u: (1 - np.cos(np.pi * u)) / 2,
    "sineHalfWave": lambda u: (1 - np.cos(np.pi * u)) / 2,
    "sinusoid": lambda u: u - np.sin(2 * np.pi * u) / (2 * np.pi),
    "bloss": lambda u: 3 * u**2 - 2 * u**3,
    "biquadratic": lambda u: np.where(u < 0.5, 2 * u**2, 1 - 2 * (1 - u) ** 2),
}
CUBICS = ("cubicParabola", "japaneseCubic")


@dataclass(frozen=True)
class Part:
    """An element as the tests write it: its kind, its length and its curvatures, left positive."""

    kind: str
    length: float
    start: float = 0.0
    end: float = 0.0


def cubic_by_arc(part, s):
    """Curvature and heading (from the start) of a cubic parabola, its arc length by quadrature over a fine grid."""
    side = np.sign(part.end - part.start)
    low, high = side * part.start, side * part.end

    def over_tangent(rate):
        x = np.linspace(low / rate, high / rate, 4001)
        return x, CubicSpline(x, np.hypot(1, 0.5 * rate * x * x)).antiderivative()(x)

    rate = (high - low) / part.length
    for _ in range(20):
        rate *= over_tangent(rate)[1][-1] / part.length
    x, arc = over_tangent(rate)
    at = CubicSpline(arc, x)(s)
    heading = side * (np.arctan(0.5 * rate * at**2) - np.arctan(0.5 * rate * x[0] ** 2))
    return side * rate * at / np.hypot(1, 0.5 * rate * at**2) ** 3, heading


class Truth:
    """Curvature, heading and place over the plan, by quadrature that knows nothing of the package."""

    def __init__(self, parts, start=0j, yaw=0.0):
        nodes, weights = np.polynomial.legendre.leggauss(6)
        self.places, self.headings, self.length = [start], [yaw], 0.0
        plan, curvature, heading, place = [], [], [], []
        for part in parts:
            n = int(np.ceil(part.length / 2.0)) * 2
            edges = np.linspace(0, part.length, n + 1)
            half = 0.5 * np.diff(edges)[:, None]
            at = edges[:-1, None] + half * (1 + nodes)
            if part.kind in CUBICS:
                _, turn = cubic_by_arc(part, at)
                at_edges, turn_edges = cubic_by_arc(part, edges)
            else:
                shape = SHAPES.get(part.kind, lambda u: 0.0 * u)
                at_edges = part.start + (part.end - part.start) * shape(edges / part.length)
                # The heading at a node: another quadrature, from the panel's edge to it.
                inner = edges[:-1, None, None] + 0.5 * (at - edges[:-1, None])[..., None] * (1 + nodes)
                values = part.start + (part.end - part.start) * shape(inner / part.length)
                within = np.sum(0.5 * (at - edges[:-1, None])[..., None] * weights * values, axis=-1)
                whole = part.start + (part.end - part.start) * shape(at / part.length)
                turn_edges = np.concatenate([[0.0], np.cumsum(np.sum(half * weights * whole, axis=1))])
                turn = turn_edges[:-1, None] + within
            steps = np.sum(half * weights * np.exp(1j * (self.headings[-1] + turn)), axis=1)
            plan.append(self.length + edges)
            curvature.append(at_edges)
            heading.append(self.headings[-1] + turn_edges)
            place.append(self.places[-1] + np.concatenate([[0.0], np.cumsum(steps)]))
            self.length += part.length
            self.headings.append(heading[-1][-1])
            self.places.append(place[-1][-1])
        self.plan, self.curvature, self.heading, self.place = map(np.concatenate, (plan, curvature, heading, place))


def point(tag, place):
    return f"<{tag}>{place.imag!r} {place.real!r}</{tag}>"


def written(part, start, end, heading, scale=1.0):
    """One element; lengths and coordinates in units of ``scale`` metres."""
    start, end = complex(start / scale), complex(end / scale)
    ends = point("Start", start) + point("End", end)
    length = f'length="{part.length / scale!r}"'
    if part.kind == "Line":
        return f"<Line {length}>{ends}</Line>"
    side = part.start or part.end
    rot = "ccw" if side > 0 else "cw"
    if part.kind == "Curve":
        centre = complex(start + 1j * np.exp(1j * heading) / part.start / scale)
        radius = f'radius="{abs(1 / part.start) / scale!r}"'
        return f'<Curve rot="{rot}" crvType="arc" {radius} {length}>{ends}{point("Center", centre)}</Curve>'
    radii = ["INF" if k == 0 else repr(abs(1 / k) / scale) for k in (part.start, part.end)]
    tangent = point("PI", complex(start + np.exp(1j * heading) * 0.6 * part.length / scale))
    return (
        f'<Spiral spiType="{part.kind}" rot="{rot}" {length} radiusStart="{radii[0]}" radiusEnd="{radii[1]}">'
        f"{ends}{tangent}</Spiral>"
    )


METRIC = '<Metric linearUnit="meter" areaUnit="squareMeter" volumeUnit="cubicMeter" temperatureUnit="celsius" pressureUnit="HPA"/>'  # noqa: E501


def document(alignment, units=METRIC):
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2" date="2026-01-01" time="00:00:00">'
        f"<Units>{units}</Units><Alignments>{alignment}</Alignments></LandXML>"
    )


def alignment_of(parts, truth, *, station=1000.0, rest="", length=None, scale=1.0):
    elements = "".join(
        written(part, *ends, heading, scale)
        for part, *ends, heading in zip(parts, truth.places[:-1], truth.places[1:], truth.headings[:-1], strict=True)
    )
    total = truth.length if length is None else length
    return (
        f'<Alignment name="down" length="{total / scale!r}" staStart="{station / scale!r}">'
        f"<CoordGeom>{elements}</CoordGeom>{rest}</Alignment>"
    )


def curve(kind, radius, length, circle=60.0, straight=40.0):
    """Straight, transition, circle, transition."""
    return [
        Part("Line", straight),
        Part(kind, length, 0.0, 1 / radius),
        Part("Curve", circle, 1 / radius, 1 / radius),
        Part(kind, length, 1 / radius, 0.0),
    ]


EVERY_TYPE = [
    part
    for kind in ("clothoid", "cosine", "sinusoid", "bloss", "biquadratic", "cubicParabola", "japaneseCubic")
    for side in (1, -1)
    for part in curve(kind, side * 310.0, 70.0)
] + [
    Part("Line", 25.0),
    Part("clothoid", 40.0, 0.0, -1 / 500),
    Part("cubicParabola", 30.0, -1 / 500, -1 / 250),
    Part("Curve", 50.0, -1 / 250, -1 / 250),
    Part("bloss", 45.0, -1 / 250, -1 / 900),
    Part("cosine", 45.0, -1 / 900, 0.0),
    Part("Line", 25.0),
]
START, YAW = 432_100.25 + 5_123_456.5j, 0.7


@pytest.fixture
def read(tmp_path):
    """Reads a document written to a file."""

    def function(text, **options):
        path = tmp_path / "line.xml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_landxml(path, **{"speed_limit_mps": 25.0, **options})

    return function


def assert_follows(result, truth):
    """To 1e-7 m and 1e-10 1/m, at every edge of the truth's quadrature."""
    s = result.plan.space_at(truth.plan)
    gamma = result.line.grade(s)
    places = result.line.position(s)[:, :2] + result.start_m[:2]
    np.testing.assert_allclose(places @ [1, 1j], truth.place, rtol=0, atol=1e-7)
    # Not at joints, where the curvature may jump.
    inside = np.diff(truth.plan, prepend=-1.0, append=1e9)
    smooth = (inside[1:] > 0) & (inside[:-1] > 0)
    curvature = result.line.curvature(s) / np.cos(gamma)
    np.testing.assert_allclose(curvature[smooth], truth.curvature[smooth], atol=1e-10)
    np.testing.assert_allclose(result.line.yaw(s), truth.heading, atol=1e-9)


def test_every_element_type_and_both_senses_are_read_back_to_their_coordinates(read):
    truth = Truth(EVERY_TYPE, START, YAW)
    result = read(document(alignment_of(EVERY_TYPE, truth)))
    assert result.name == "down"
    assert result.station_start_m == 1000.0
    assert result.line.length_m == pytest.approx(truth.length, abs=1e-9)
    assert_follows(result, truth)
    assert [remark for remark in result.remarks if "profile" not in remark] == []


PROFILE = (
    "<Profile><ProfAlign name='design'><PVI>1000 50</PVI><CircCurve length='120' radius='-4000'>1400 62</CircCurve>"
    "<ParaCurve length='200'>2000 50</ParaCurve><PVI>{end!r} 60</PVI></ProfAlign></Profile>"
)


def heights(plan, length):
    """Heights and gradients of PROFILE: straight, circle of 4000 m (a crest), parabola of 200 m (a sag)."""
    slopes = [12 / 400, -12 / 600, 10 / (length - 1000)]
    z = np.where(plan < 400, 50 + slopes[0] * plan, 62 + slopes[1] * (plan - 400))
    z = np.where(plan > 1000, 50 + slopes[2] * (plan - 1000), z)
    gamma = np.arctan(slopes[:2])
    tangent = 4000 * np.tan((gamma[0] - gamma[1]) / 2)
    begin, end = 400 - tangent * np.cos(gamma[0]), 400 + tangent * np.cos(gamma[1])
    centre = begin + 4000 * np.sin(gamma[0]), 62 - tangent * np.sin(gamma[0]) - 4000 * np.cos(gamma[0])
    on_circle = (plan > begin) & (plan < end)
    z[on_circle] = centre[1] + np.sqrt(4000**2 - (plan[on_circle] - centre[0]) ** 2)
    q = plan - 900
    on_parabola = (q > 0) & (q < 200)
    z[on_parabola] = (52 + slopes[1] * q + (slopes[2] - slopes[1]) * q**2 / 400)[on_parabola]
    return z


def test_heights_and_lengths_in_space_follow_the_profile(read):
    truth = Truth(EVERY_TYPE, START, YAW)
    rest = PROFILE.format(end=1000 + truth.length)
    result = read(document(alignment_of(EVERY_TYPE, truth, rest=rest)))
    assert_follows(result, truth)
    exact = heights(truth.plan, truth.length)
    s = result.plan.space_at(truth.plan)
    np.testing.assert_allclose(result.line.position(s)[:, 2] + result.start_m[2], exact, atol=1e-8)
    np.testing.assert_allclose(result.plan.plan_at(s), truth.plan, atol=1e-9)
    fine = np.linspace(0, truth.length, 400_001)
    slope = np.gradient(heights(fine, truth.length), fine)
    in_space = cumulative_trapezoid(np.hypot(1, slope), fine, initial=0)
    np.testing.assert_allclose(result.plan.space_at(fine[::1000]), in_space[::1000], atol=1e-5)
    assert result.line.length_m > truth.length
    # On a circle the angle is linear in arc length; its slope is minus one over the radius, a crest.
    assert result.line.grade(result.plan.space_at(np.array([390.0, 410.0])), 1) == pytest.approx([-1 / 4000] * 2)
    slopes = np.tan(result.line.grade(result.plan.space_at(np.array([100.0, 1500.0]))))
    np.testing.assert_allclose(slopes, [0.03, 10 / (truth.length - 1000)])


CANT = (
    '<Cant name="cant" gauge="{gauge}" rotationPoint="center" equilibriumConstant="11.8">'
    '<CantStation station="1000" appliedCant="0" curvature="ccw"/>'
    '<CantStation station="1040" appliedCant="0" equilibriumCant="77" curvature="{sense}" {kind}/>'
    '<CantStation station="1110" appliedCant="100" curvature="{sense}"/>'
    '<CantStation station="1170" appliedCant="100" curvature="{sense}"/>'
    '<CantStation station="1240" appliedCant="0" curvature="{sense}"/></Cant>'
)


@pytest.mark.parametrize(("sense", "sign"), [("ccw", -1), ("cw", 1)])
@pytest.mark.parametrize(
    ("spiral", "kind", "shape"),
    [
        ("bloss", "", "bloss"),
        ("cosine", "", "cosine"),
        ("cubicParabola", "", "clothoid"),
        ("bloss", 'transitionType="sinusoid"', "sinusoid"),
    ],
)
def test_cant_raises_the_outer_rail_by_the_law_of_the_spiral_or_its_own(read, sense, sign, spiral, kind, shape):
    parts = [*curve(spiral, -sign * 400.0, 70.0), Part("Line", 30.0)]
    truth = Truth(parts)
    cant = CANT.format(gauge=1.435, sense=sense, kind=kind)
    result = read(document(alignment_of(parts, truth, rest=cant)))
    assert result.gauge_m == 1.435
    assert result.line.cross_level_base_m == 1.435
    plan = np.linspace(40, 110, 71)
    exact = sign * 0.1 * SHAPES[shape]((plan - 40) / 70)
    np.testing.assert_allclose(result.line.cant(plan), exact, atol=1e-12)
    np.testing.assert_allclose(result.line.cant(np.array([20.0, 140.0, 260.0])), [0, sign * 0.1, 0], atol=1e-12)
    assert result.plan.curvature(140.0) * result.plan.cant(140.0) < 0


def test_adverse_cant_gauge_in_millimetres_and_a_given_base(read):
    parts = [*curve("bloss", 400.0, 70.0), Part("Line", 30.0)]
    cant = CANT.format(gauge=1067, sense="ccw", kind="").replace('curvature="ccw"', 'curvature="ccw" adverse="true"')
    result = read(document(alignment_of(parts, Truth(parts), rest=cant)), cross_level_base_m=1.067)
    assert result.gauge_m == pytest.approx(1.067)
    assert result.line.cant(140.0) == pytest.approx(0.1)


@pytest.mark.parametrize(("unit", "scale"), [("foot", 0.3048), ("USSurveyFoot", 1200 / 3937)])
def test_feet_become_metres_and_inches_of_cant_too(read, unit, scale):
    parts = curve("clothoid", 300.0, 70.0)
    truth = Truth(parts, 1000 + 2000j, 0.3)
    at = f'station="{1110 / scale!r}" appliedCant="4" curvature="ccw"'
    cant = f'<Cant gauge="{1.435 / scale!r}"><CantStation {at}/></Cant>'
    profile = (
        f"<Profile><ProfAlign><PVI>{1000 / scale!r} 100</PVI><PVI>{1100 / scale!r} 101</PVI></ProfAlign></Profile>"
    )
    text = alignment_of(parts, truth, scale=scale, rest=cant + profile)
    result = read(document(text, units=f'<Imperial linearUnit="{unit}"/>'))
    assert_follows(result, truth)
    assert result.line.cant(120.0) == pytest.approx(-4 * 0.0254)
    assert result.line.cross_level_base_m == pytest.approx(1.435)
    assert result.start_m[2] == pytest.approx(100 * scale)
    assert np.tan(result.line.grade(result.plan.space_at(np.array(50.0)))) == pytest.approx(scale / 100)
    assert result.station_start_m == pytest.approx(1000.0)


def test_lengths_and_radius_may_come_from_coordinates(read):
    parts = [Part("Line", 50.0), Part("Curve", 120.0, -1 / 200, -1 / 200), Part("Curve", 1000.0, 1 / 250, 1 / 250)]
    truth = Truth(parts, START, YAW)
    text = alignment_of(parts, truth)
    coordgeom = text.index("<CoordGeom>")
    head, tail = text[:coordgeom], text[coordgeom:]
    for attribute in ("length", "radius"):
        while (at := tail.find(f' {attribute}="')) >= 0:
            tail = tail[:at] + tail[tail.index('"', at + len(attribute) + 3) + 1 :]
    assert_follows(read(document(head + tail)), truth)


@pytest.mark.parametrize("radius", [300.0, -300.0])
def test_a_curve_may_be_given_by_its_chord_and_radius(read, radius):
    parts = curve("clothoid", radius, 60.0, circle=250.0)
    truth = Truth(parts, START, YAW)
    text = document(alignment_of(parts, truth))
    text = re.sub(r'(<Curve [^>]*) length="[^"]*"', r"\1", text)

    result = read(re.sub(r"<Center>[^<]*</Center>", "", text))

    assert_follows(result, truth)
    assert remarks_without_profile(result) == []


def test_points_may_be_those_of_the_file_by_name(read):
    parts = curve("bloss", 400.0, 60.0)
    truth = Truth(parts, START, YAW)
    points = []

    def named(match):
        points.append(f'<CgPoint name="p{len(points)}">{match[2]}</CgPoint>')
        return f'<{match[1]} pntRef="p{len(points) - 1}"/>'

    text = re.sub(r"<(Start|End|Center|PI)>([^<]*)</\1>", named, document(alignment_of(parts, truth)))
    with_points = text.replace("<Alignments>", f"<CgPoints>{''.join(points)}</CgPoints><Alignments>")

    assert_follows(read(with_points), truth)
    with pytest.raises(BadInputError, match="Start is the point 'p0', which is none of the file: expected a CgPoint"):
        read(with_points.replace('name="p0"', 'name="other"'))


def test_every_alignment_is_a_track_of_a_known_line(tmp_path):
    written = []
    for name, radius in (("down", 400.0), ("up", -900.0)):
        parts = curve("clothoid", radius, 60.0)
        truth = Truth(parts, START, YAW)
        written.append((name, alignment_of(parts, truth).replace("down", name), truth.places[-1]))
    path = tmp_path / "line.xml"
    profile_alone = '<Alignment name="profile alone" length="1" staStart="0"/>'
    text = document("".join(text for _, text, _ in written) + profile_alone)
    path.write_text(text.replace("<Alignments>", '<CoordinateSystem epsgCode="3067"/><Alignments>'))

    tracks, code = read_plans(path, step_m=5.0)

    assert (list(tracks), code) == (["down", "up"], "3067")
    for name, _, end in written:
        np.testing.assert_allclose(tracks[name][[0, -1]] @ [1, 1j], [START, end], atol=1e-6)
        assert np.linalg.norm(np.diff(tracks[name], axis=0), axis=1).max() < 5.0 + 1e-6
    assert list(read_plans(path, name="up", step_m=5.0)[0]) == ["up"]
    with pytest.raises(
        BadInputError, match="has 3 alignments: 'down', 'up', 'profile alone': expected exactly one named"
    ):
        read_plans(path, name="x", step_m=5.0)
    path.write_text(text.replace('"up"', '"down"'))
    with pytest.raises(BadInputError, match="another one is named 'down': expected different names"):
        read_plans(path, step_m=5.0)


def test_the_first_element_may_be_a_curve_or_a_spiral(read):
    for parts in (EVERY_TYPE[1:4], EVERY_TYPE[2:4]):
        truth = Truth(parts, START, YAW)
        assert_follows(read(document(alignment_of(parts, truth))), truth)


RADII = st.floats(150.0, 3000.0)
LENGTHS = st.floats(5.0, 200.0)
KINDS = st.sampled_from([*SHAPES, *CUBICS])


@st.composite
def sequences(draw):
    """Curves to either side, simple or compound, with or without straights between them."""
    parts = [Part("Line", draw(LENGTHS))]
    for _ in range(draw(st.integers(1, 4))):
        side = draw(st.sampled_from([-1, 1]))
        curvature = 0.0
        for _ in range(draw(st.integers(1, 3))):
            target = side / draw(RADII)
            if target != curvature:
                kind, length = draw(KINDS), draw(st.floats(5.0, 90.0))
                # A cubic parabola cannot join nearly equal curvatures: it would be too steep where it has them.
                steep = max(abs(target), abs(curvature)) ** 2 * length / (2 * abs(target - curvature)) > 0.3
                parts.append(Part("bloss" if steep and kind in CUBICS else kind, length, curvature, target))
            parts.append(Part("Curve", draw(LENGTHS), target, target))
            curvature = target
        parts.append(Part(draw(KINDS), draw(st.floats(5.0, 90.0)), curvature, 0.0))
        if draw(st.booleans()):
            parts.append(Part("Line", draw(LENGTHS)))
    return parts


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(parts=sequences(), yaw=st.floats(-3.0, 3.0))
def test_any_sequence_of_elements_is_read_back(read, parts, yaw):
    truth = Truth(parts, START, yaw)
    result = read(document(alignment_of(parts, truth)))
    assert_follows(result, truth)
    assert not any("coordinates" in remark or "further" in remark for remark in result.remarks)


SIMPLE = [*curve("clothoid", 300.0, 60.0), Part("Line", 50.0)]
SIMPLE_TRUTH = Truth(SIMPLE, START, YAW)
GOOD = document(alignment_of(SIMPLE, SIMPLE_TRUTH))


def remarks_without_profile(result):
    return [remark for remark in result.remarks if "there is no profile" not in remark]


def test_a_wrong_header_length_is_reported_and_the_elements_win(read):
    result = read(document(alignment_of(SIMPLE, SIMPLE_TRUTH, length=300.0)))
    assert remarks_without_profile(result) == [
        "the header's length is 300.000 m, that of its elements 270.000 m: these are used"
    ]
    assert result.line.length_m == pytest.approx(270.0)


def test_coordinates_that_disagree_are_reported(read):
    moved = Truth(SIMPLE, START, YAW)
    moved.places[2] += 0.05
    remarks = " | ".join(remarks_without_profile(read(document(alignment_of(SIMPLE, moved)))))
    assert "element 2 (Spiral): its Start and End are +0." in remarks
    assert (
        "from element 2 (Spiral) on, the file's coordinates are off the elements laid end to end, by up to 0.05"
        in remarks
    )

    gap = GOOD.replace(
        point("Start", complex(SIMPLE_TRUTH.places[4])), point("Start", complex(SIMPLE_TRUTH.places[4]) - 0.5)
    )
    assert any("element 5 (Line): starts 0.500 m from the end" in remark for remark in read(gap).remarks)

    centre = complex(SIMPLE_TRUTH.places[2] + 1j * np.exp(1j * SIMPLE_TRUTH.headings[2]) * 300.0)
    away = centre + 2 * complex(1j * np.exp(1j * SIMPLE_TRUTH.headings[2]))
    wrong = GOOD.replace(point("Center", centre), point("Center", away))
    assert any("its Start is +2.000 m further from its Center" in remark for remark in read(wrong).remarks)


def test_a_shift_below_a_centimetre_is_not_reported(read):
    moved = Truth(SIMPLE, START, YAW)
    moved.places[2] += 0.004
    assert remarks_without_profile(read(document(alignment_of(SIMPLE, moved)))) == []


def test_what_is_not_used_is_reported(read):
    near = [
        part if part.kind != "clothoid" else Part("sineHalfWave", *list(vars(part).values())[1:]) for part in SIMPLE
    ]
    rest = (
        '<StaEquation staInternal="1100" staBack="1100" staAhead="1200"/>'
        "<Profile><ProfAlign name='a'><PVI>1000 0</PVI><PVI>1100 1</PVI><PVI>1200 0</PVI></ProfAlign>"
        "<ProfAlign name='b'/></Profile>"
        '<Cant gauge="1.5" rotationPoint="insideRail"><CantStation station="1100" appliedCant="20" curvature="cw"/>'
        "</Cant>"
    )
    remarks = read(document(alignment_of(near, Truth(near, START, YAW), rest=rest))).remarks
    for words in (
        "element 2 (Spiral): sineHalfWave is read as the half-sine curve",
        "there are 2 profiles: the first, 'a', is used",
        "the profile does not span the plan",
        "the gradient jumps at 1 point(s) without a vertical curve, first at station 1100.000 m",
        "cant is not zero at the first or last CantStation",
        "cant turns about insideRail",
    ):
        assert sum(words in remark for remark in remarks) == 1, (words, remarks)


def test_one_of_several_alignments_is_chosen_by_name(read):
    two = alignment_of(SIMPLE, SIMPLE_TRUTH) + alignment_of(SIMPLE[:1], Truth(SIMPLE[:1])).replace('"down"', '"up"')
    assert read(document(two), name="up").line.length_m == pytest.approx(40.0)
    with pytest.raises(
        BadInputError, match="has 2 alignments: 'down', 'up': expected exactly one, or a choice by name"
    ):
        read(document(two))
    with pytest.raises(BadInputError, match="expected exactly one named 'side'"):
        read(document(two), name="side")


@pytest.mark.parametrize(
    ("namespace", "version"),
    [
        ("http://www.landxml.org/schema/LandXML-1.1", "1.1"),
        ("http://www.landxml.org/schema/LandXML-2.0", "2.0"),
        ("http://www.inframodel.fi/inframodel", "1.2"),
        ("http://buildingsmart.fi/inframodel/404", "1.2"),
    ],
)
def test_other_versions_and_inframodel_are_read_the_same(read, namespace, version):
    text = GOOD.replace("http://www.landxml.org/schema/LandXML-1.2", namespace)
    result = read(text.replace('version="1.2"', f'version="{version}"'))
    assert remarks_without_profile(result) == []
    assert result.line.length_m == read(GOOD).line.length_m


def test_a_version_that_is_not_the_namespaces_is_reported(read):
    assert remarks_without_profile(read(swap('version="1.2"', 'version="2.0"'))) == [
        "its version is '2.0', its namespace that of 1.2: it is read as 1.2"
    ]


def test_an_element_without_length_is_left_out_and_reported(read):
    centre = complex(START + 1j * np.exp(1j * YAW) * 300.0)
    empty = f'<Curve rot="ccw" radius="300" length="0.000">{point("Start", START)}{point("End", START)}'
    empty += f"{point('Center', centre)}</Curve>"
    result = read(swap("<CoordGeom>", f"<CoordGeom>{empty}"))
    assert remarks_without_profile(result) == ["element 1 (Curve): its length is 0: it is left out"]
    assert result.line.length_m == pytest.approx(270.0)


def test_the_centre_of_a_flat_arc_makes_no_remark(read):
    """A radius of 50 km that is off by 0.4 m moves an arc of 100 m by 1e-6 m, a centre 20 m along it by 4 cm."""
    parts = [Part("Line", 40.0), Part("Curve", 100.0, 2e-5, 2e-5), Part("Line", 40.0)]
    truth = Truth(parts, START, YAW)
    text = document(alignment_of(parts, truth))
    heading = np.exp(1j * truth.headings[1])
    centre = complex(truth.places[1] + 1j * heading * 50_000.0)
    assert centre_tag(text) == point("Center", centre)
    for away in (0.4j * heading, 3.0 * heading):
        assert (
            remarks_without_profile(read(text.replace(centre_tag(text), point("Center", complex(centre + away))))) == []
        )
    turned = point("Center", complex(centre + 20.0 * heading))
    (reported,) = remarks_without_profile(read(text.replace(centre_tag(text), turned)))
    assert "off the elements laid end to end, by up to 0.04" in reported


def centre_tag(text):
    return text[text.index("<Center>") : text.index("</Center>") + len("</Center>")]


def cant_at(*stations):
    return "".join(
        f'<CantStation station="{station}" appliedCant="{cant}" curvature="cw"/>' for station, cant in stations
    )


def test_cant_stations_beyond_the_plan_count_for_what_lies_on_it(read):
    stations = cant_at((980.0, 0.0), (1020.0, 40.0), (1250.0, 40.0), (1290.0, 0.0))
    result = read(swap("</Alignment>", ONE_CANT.format(stations)))
    assert [remark for remark in remarks_without_profile(result) if "cant is not zero" not in remark] == [
        "2 CantStation(s) beyond the plan, by up to 20.000 m: the cant on the plan is used"
    ]
    assert 1e3 * result.line.cant(np.array([0.0, 10.0, 20.0, 100.0, 250.0, 260.0, 270.0])) == pytest.approx(
        [20.0, 30.0, 40.0, 40.0, 40.0, 30.0, 20.0]
    )


def test_station_equations_make_the_kilometrage(read):
    text = swap(
        "</Alignment>",
        '<StaEquation staInternal="1100" staBack="1100" staAhead="1200"/>'
        '<StaEquation staInternal="1150" staBack="1251" staAhead="5000" staIncrement="decreasing"/></Alignment>',
    )
    result = read(text)
    (reported,) = remarks_without_profile(result)
    assert reported.endswith("StaEquation 2: staBack is 1251, the station there is 1250.000 m: this is used")
    line = result.kilometrage.kilometrage()
    assert line.written(np.array([1000.0, 1099.0, 1100.0, 1149.0, 1150.0, 1200.0])) == [
        "1+000.00", "1+099.00", "1+200.00", "1+249.00", "5+000.00", "4+950.00",
    ]  # fmt: skip
    assert [(jump.kind, jump.chainage_m) for jump in line.jumps] == [("gap", 1100.0), ("turn", 1150.0)]
    assert result.kilometrage.end_chainage_m == pytest.approx(1270.0)


def test_kilometrage_is_measured_in_plan_and_chainage_along_the_track(read):
    profile = ONE_PROFILE.format(
        "<PVI>1000 0</PVI><CircCurve length='60' radius='2000'>1100 3</CircCurve><PVI>1270 -2.1</PVI>"
    )
    result = read(swap("</Alignment>", '<StaEquation staInternal="1180" staAhead="2000"/>' + profile))
    plan = np.linspace(0.0, 270.0, 541)
    chainage = 1000.0 + result.plan.space_at(plan)
    station = np.where(plan < 180.0, 1000.0 + plan, 2000.0 + plan - 180.0)
    beside = np.abs(plan - 180.0) > 0.1
    official = result.kilometrage.kilometrage().official_m(chainage)
    assert np.abs(official - station)[beside].max() < 2e-4
    assert chainage[-1] - 1270.0 > 0.05


def test_an_equation_of_inframodel_is_a_kilometre_post(read):
    posts = "".join(
        f'<StaEquation staInternal="{at}" staAhead="{at}" staBack="{back}" desc="{km}"/>'
        for at, back, km in ((-1, "NaN", "0000"), (1002.5, 1003.5, "0001"), (1250.0, 247.5, "2"), (1260.0, 10.0, "3A"))
    )
    text = swap("http://www.landxml.org/schema/LandXML-1.2", "http://www.inframodel.fi/inframodel")
    text = text.replace("<Alignments>", '<Alignments name="003">').replace("</Alignment>", posts + "</Alignment>")
    result = read(text)
    (reported,) = remarks_without_profile(result)
    assert reported.endswith("StaEquation 4: desc is '3A', no kilometre: this post is not used")
    assert (result.kilometrage.line, result.kilometrage.track) == ("003", "down")
    line = result.kilometrage.kilometrage()
    assert line.written(np.array([1001.0, 1003.5, 1249.0, 1251.0])) == [
        "0+1002.00", "1+001.00", "1+246.50", "2+001.00",
    ]  # fmt: skip
    assert line.read("0+1002") == pytest.approx(1001.0)


LAUGHS = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10 if i else "ha" * 50}">' for i in range(10))
SPIRAL = "element 2 \\(Spiral\\)"
ONE_PROFILE = "<Profile><ProfAlign name='p'>{}</ProfAlign></Profile></Alignment>"
ONE_CANT = '<Cant gauge="1.5">{}</Cant></Alignment>'


def swap(old, new):
    assert old in GOOD
    return GOOD.replace(old, new)


BAD = {
    "empty": ("", "not well-formed XML"),
    "truncated": (GOOD[: len(GOOD) // 2], "not well-formed XML"),
    "not XML": ("chainage,curvature\n0,0\n", "not well-formed XML"),
    "binary": (b"\x00\xff\xfe\x01" * 50, "not well-formed XML"),
    "another document": ("<html/>", "its root is html of namespace None: expected LandXML"),
    "wrong namespace": (swap("LandXML-1.2", "LandXML-1.0"), "expected LandXML of namespace"),
    "no namespace": (swap('xmlns="http://www.landxml.org/schema/LandXML-1.2"', ""), "expected LandXML of namespace"),
    "entities": (
        f"<!DOCTYPE LandXML [{LAUGHS}]>" + GOOD.split("\n")[1].replace("<Alignments>", "&l9;<Alignments>"),
        "document type|not well-formed",
    ),
    "entities in an attribute": (
        f"<!DOCTYPE LandXML [{LAUGHS}]>" + GOOD.split("\n")[1].replace('name="down"', 'name="&l9;"'),
        "document type|not well-formed",
    ),
    "a file as entity": (
        '<!DOCTYPE LandXML [<!ENTITY x SYSTEM "file:///etc/hostname">]>' + GOOD.split("\n")[1].replace("down", "d&x;"),
        "document type|not well-formed",
    ),
    "no units": (swap(f"<Units>{METRIC}</Units>", ""), "LandXML: the units are missing"),
    "unknown unit": (swap('"meter"', '"furlong"'), "linearUnit is 'furlong': expected one of meter"),
    "no alignment": (document(""), "has no Alignment"),
    "no elements": (document('<Alignment name="a"><CoordGeom/></Alignment>'), "has no elements"),
    "no plan": (document('<Alignment name="a"/>'), "has no CoordGeom"),
    "spiral without length": (
        swap('rot="ccw" length="60.0" radiusS', 'rot="ccw" radiusS'),
        f"{SPIRAL}: length is missing",
    ),
    "spiral without sense": (swap('spiType="clothoid" rot="ccw"', 'spiType="clothoid"'), f"{SPIRAL}: rot is missing"),
    "spiral without radius": (swap('radiusStart="INF"', ""), f"{SPIRAL}: radiusStart is missing"),
    "unknown spiral": (swap('"clothoid"', '"radioid"'), f"{SPIRAL}: spiType is 'radioid': expected one of clothoid"),
    "radius zero": (
        swap('radiusEnd="300.0"', 'radiusEnd="0"'),
        f"{SPIRAL}: radiusEnd is '0': expected a number above 0",
    ),
    "radius NaN": (swap('radiusEnd="300.0"', 'radiusEnd="NaN"'), f"{SPIRAL}: radiusEnd is 'NaN'"),
    "length NaN": (
        swap('length="40.0"', 'length="nan"'),
        r"element 1 \(Line\): length is 'nan': expected a number above",
    ),
    "length negative": (swap('length="40.0"', 'length="-40"'), r"element 1 \(Line\): length is '-40'"),
    "length infinite": (swap('length="40.0"', 'length="1e999"'), r"element 1 \(Line\): length is '1e999'"),
    "a line round the world": (swap('length="40.0"', 'length="4e7"'), "its elements are 40000.2 km long: expected"),
    "radius below ten metres": (swap('radiusEnd="300.0"', 'radiusEnd="0.3"'), f"{SPIRAL}: its radius is below 10 m"),
    "length in words": (swap('length="40.0"', 'length="long"'), r"element 1 \(Line\): length is 'long'"),
    "unknown element": (
        swap("<Line ", "<Chain ").replace("</Line>", "</Chain>"),
        r"element 1 \(Chain\): cannot be read",
    ),
    "a coordinate": (swap(point("Start", START), "<Start>12 east</Start>"), "Start: its text is '12 east'"),
    "no coordinates": (swap(point("Start", START), ""), r"element 1 \(Line\) has no direction"),
    "steep cubic parabola": (
        swap('"clothoid"', '"cubicParabola"').replace('radiusEnd="300.0"', 'radiusEnd="30.0"'),
        f"{SPIRAL}: a cubic parabola 60 m long .* steeper than 24.1 degrees",
    ),
    "one vertex": (
        swap("</Alignment>", ONE_PROFILE.format("<PVI>1000 0</PVI>")),
        "ProfAlign 'p': 1 vertices: expected",
    ),
    "steep": (
        swap("</Alignment>", ONE_PROFILE.format("<PVI>1000 0</PVI><PVI>1010 50</PVI>")),
        r"the gradient from point 1 \(PVI\) to point 2 \(PVI\) is 5000 permille: expected at most 500",
    ),
    "vertices out of order": (
        swap("</Alignment>", ONE_PROFILE.format("<PVI>1100 0</PVI><PVI>1000 0</PVI>")),
        r"point 2 \(PVI\) is not beyond point 1",
    ),
    "vertical curves overlap": (
        swap(
            "</Alignment>",
            ONE_PROFILE.format(
                "<PVI>1000 0</PVI><ParaCurve length='100'>1080 1</ParaCurve><CircCurve length='9' radius='5000'>1150 0"
                "</CircCurve><PVI>1270 0</PVI>"
            ),
        ),
        r"point 3 \(CircCurve\) begins .* before the curve before it ends",
    ),
    "unsymmetrical curve": (
        swap("</Alignment>", ONE_PROFILE.format("<UnsymParaCurve lengthIn='1' lengthOut='2'>1 2</UnsymParaCurve>")),
        r"point 1 \(UnsymParaCurve\): cannot be read",
    ),
    "height in words": (
        swap("</Alignment>", ONE_PROFILE.format("<PVI>1000 high</PVI>")),
        "point 1 .* expected 2 numbers",
    ),
    "cant without gauge": (swap("</Alignment>", "<Cant/></Alignment>"), "Cant: gauge is missing"),
    "cant without sense": (
        swap("</Alignment>", ONE_CANT.format('<CantStation station="1100" appliedCant="9"/>')),
        "CantStation 1: curvature is missing: expected one of cw, ccw",
    ),
    "cant jumps": (
        swap(
            "</Alignment>",
            ONE_CANT.format(
                '<CantStation station="1100" appliedCant="0"/>'
                '<CantStation station="1100" appliedCant="90" curvature="cw"/>'
            ),
        ),
        r"CantStation 2: the height of the left rail over the right one jumps by \+90.0 mm: expected a ramp",
    ),
    "cant out of order": (
        swap(
            "</Alignment>",
            ONE_CANT.format(
                '<CantStation station="1100" appliedCant="0"/><CantStation station="1090" appliedCant="0"/>'
            ),
        ),
        "CantStation 2: its station is before",
    ),
    "cant outside": (
        swap("</Alignment>", ONE_CANT.format('<CantStation station="100" appliedCant="40" curvature="cw"/>')),
        "CantStation 1: its station is -900.000 m from the start of the plan: expected some on the plan, 0 to 270.000",
    ),
    "cant in micrometres": (
        swap("</Alignment>", ONE_CANT.format('<CantStation station="1100" appliedCant="90000" curvature="cw"/>')),
        "a cant of 90000 mm over 1.5 m",
    ),
}


@pytest.mark.parametrize("fault", BAD)
def test_a_bad_file_gives_one_clear_error(read, fault):
    text, message = BAD[fault]
    with pytest.raises(BadInputError, match=message) as caught:
        read(text)
    assert "line.xml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_and_a_huge_file_are_refused(tmp_path):
    with pytest.raises(BadInputError, match=r"none\.xml: cannot be read: No such file"):
        read_landxml(tmp_path / "none.xml", speed_limit_mps=25.0)
    huge = tmp_path / "huge.xml"
    with huge.open("wb") as file:
        file.truncate(300 * 2**20)
    with pytest.raises(BadInputError, match="it has 300 MiB: expected at most 256 MiB"):
        read_landxml(huge, speed_limit_mps=25.0)
