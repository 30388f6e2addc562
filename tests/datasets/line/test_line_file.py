"""Lines from files, by suffix; and the speeds that curves allow where a file says none."""

import numpy as np
import pytest

from trackfg import datasets
from trackfg.datasets.catalogue import scenario
from trackfg.datasets.line.line_file import UNCOMPENSATED_MPS2, read_line_file, with_curve_limits
from trackfg.errors import BadInputError
from trackfg.numerics import units

TOML = """
format = "trackfg-line/1"
id = "branch"
gauge_m = 1.067
cross_level_base_m = 1.067
start_chainage_m = 12000.0
heading_deg = 75.0
speed_limit = [{chainage_m = 12000.0, kmh = 40}]
element = [{type = "straight", length_m = 900.0}]
"""
XML = """<LandXML version="1.2" xmlns="http://www.landxml.org/schema/LandXML-1.2">
<Units><Metric linearUnit="meter"/></Units>
<Alignments><Alignment name="down" length="900" staStart="500"><CoordGeom>
<Line length="300"><Start>0 0</Start><End>0 300</End></Line>
<Curve rot="ccw" radius="300" length="200"/>
<Line length="400"/>
</CoordGeom></Alignment></Alignments></LandXML>"""


@pytest.fixture
def write(tmp_path):
    def write(name, text):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path / name

    return write


def test_a_toml_description(write):
    given = read_line_file(write("branch.toml", TOML))
    assert (given.name, given.gauge_m, given.chainage_origin_m) == ("branch", 1.067, 12_000.0)
    assert given.line.cross_level_base_m == 1.067
    assert given.line.yaw(np.zeros(())) == pytest.approx(np.radians(15.0))
    run = datasets.simulate(scenario("mainline").on(given), duration_s=120.0)
    assert 0.7 * 40 * units.KMH < run.truth["speed_mps"].max() <= 40 * units.KMH * (1 + 1e-3)
    assert run.truth["chainage_m"][0] == 12_050.0


def test_landxml(write):
    given = read_line_file(write("branch.XML", XML))
    assert (given.name, given.gauge_m, given.chainage_origin_m) == ("down", 1.435, 500.0)
    assert any("profile" in remark for remark in given.remarks)
    run = datasets.simulate(scenario("mainline").on(given), duration_s=120.0)
    s = run.ride.motion.distance(run.truth["t_s"])
    in_curve = (s > 300.0) & (s < 500.0)
    # 0.65 m/s^2 on R 300 without cant: 13.96 m/s, which is 50 km/h in steps of 5.
    assert 0.0 < run.truth["speed_mps"][in_curve].max() <= 50 * units.KMH * (1 + 1e-3)


def test_curve_limits_keep_the_lateral_acceleration(make_line):
    s = [0, 500, 560, 800, 860, 1200, 1260, 1500, 1560, 3000]
    curvature = [0, 0, 1 / 400, 1 / 400, 0, 0, -1 / 250, -1 / 250, 0, 0]
    cant = [0, 0, -0.08, -0.08, 0, 0, 0.06, 0.06, 0, 0]
    limited = with_curve_limits(make_line(s, curvature, cant=cant))
    at = np.linspace(0.0, 3000.0, 7001)
    limit = limited.limit_mps[np.searchsorted(limited.limit_from_m, at, side="right") - 1]
    fast = np.minimum(limit, 100.0)
    lateral = limited.curvature(at) * fast**2 + units.STANDARD_GRAVITY * limited.cant(at) / 1.067
    assert np.abs(lateral[np.isfinite(limit)]).max() <= UNCOMPENSATED_MPS2 + 1e-9
    assert np.isinf(limit[at < 495.0]).all()
    circle = (at > 565.0) & (at < 795.0)
    allowed = np.sqrt((UNCOMPENSATED_MPS2 + units.STANDARD_GRAVITY * 0.08 / 1.067) * 400.0)
    assert np.all(limit[circle] == np.floor(allowed / (5 * units.KMH)) * 5 * units.KMH)


@pytest.mark.parametrize("name", ["branch.txt", "branch", "branch.landxml"])
def test_another_suffix_is_refused(write, name):
    with pytest.raises(BadInputError, match=r"expected a line description \(\.toml\) or LandXML \(\.xml\)"):
        read_line_file(write(name, TOML))
