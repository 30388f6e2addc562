"""Draw frames, signs, the versine, the graph and the lag for the docs, as SVG in docs/images/drawings.

Colours are those of the reader's system, light or dark; on the site those of the page. ``--check`` writes nothing, and
its exit status is 1 where a drawing is not what this program draws.

    python tools/drawings.py [--check]
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Sequence
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "docs" / "images" / "drawings"

_STYLE = """<style>
.drawing { --ink: #1f2328; --soft: #59636e; --paper: #ffffff; --blue: #0b5cad; --orange: #a84300; --fill: #e4ecf5 }
@media (prefers-color-scheme: dark) {
  .drawing { --ink: #e6edf3; --soft: #a5adb6; --paper: #14181e; --blue: #79b8ff; --orange: #ffa657; --fill: #26323f }
}
.drawing text { font: 14px 'DejaVu Sans', Verdana, sans-serif; fill: var(--ink) }
.drawing .small { font-size: 12px; fill: var(--soft) }
.drawing .head { font-weight: bold }
.drawing .middle { text-anchor: middle }
.drawing .end { text-anchor: end }
.drawing .blue { fill: var(--blue) }
.drawing .orange { fill: var(--orange) }
.drawing path { fill: none; stroke: var(--ink); stroke-width: 1.6 }
.drawing path.soft { stroke: var(--soft); stroke-width: 1 }
.drawing path.dashed { stroke: var(--soft); stroke-width: 1; stroke-dasharray: 5 4 }
.drawing path.blue { fill: none; stroke: var(--blue); stroke-width: 2.2 }
.drawing path.orange { fill: none; stroke: var(--orange); stroke-width: 2.2 }
.drawing path.tip { stroke: none; fill: var(--ink) }
.drawing path.tip.blue { fill: var(--blue) }
.drawing path.tip.orange { fill: var(--orange) }
.drawing path.body { fill: var(--fill) }
.drawing circle { fill: var(--fill); stroke: var(--ink); stroke-width: 1.6 }
.drawing circle.dot { fill: var(--orange); stroke: none }
.drawing rect { fill: var(--ink); stroke: none }
.drawing rect.area { fill: var(--fill) }
</style>"""

Point = tuple[float, float]


def text(at: Point, words: str, kind: str = "") -> str:
    """Return words that begin at a place; ``middle`` and ``end`` of ``kind`` say what of them is there."""
    return f'<text class="{kind}" x="{at[0]:g}" y="{at[1]:g}">{words}</text>'


def line(points: Sequence[Point], kind: str = "", *, closed: bool = False) -> str:
    """Return a line through points."""
    steps = " L".join(f"{x:.5g} {y:.5g}" for x, y in points)
    return f'<path class="{kind}" d="M{steps}{" Z" if closed else ""}"/>'


def arrow(start: Point, end: Point, kind: str = "") -> str:
    """Return an arrow."""
    return line([start, end], kind) + tip(end, math.atan2(end[1] - start[1], end[0] - start[0]), kind)


def tip(end: Point, angle: float, kind: str = "") -> str:
    """Return the tip of an arrow; ``angle`` is its direction on the sheet, rad, clockwise."""
    sides = [(end[0] - 10 * math.cos(angle + turn), end[1] - 10 * math.sin(angle + turn)) for turn in (-0.4, 0.4)]
    return line([end, *sides], f"tip {kind}", closed=True)


def turn(centre: Point, radius: float, begin: float, end: float, kind: str = "orange") -> str:
    """Return an arrow on an arc; angles in degrees, anticlockwise from the right as in a plan."""
    angles = [math.radians(begin + (end - begin) * i / 24) for i in range(25)]
    points = [(centre[0] + radius * math.cos(a), centre[1] - radius * math.sin(a)) for a in angles]
    along = -angles[-1] + (-math.pi / 2 if end > begin else math.pi / 2)
    return line(points, kind) + tip(points[-1], along, kind)


def moved(points: Sequence[Point], by: Point, degrees: float = 0.0) -> list[Point]:
    """Return points turned anticlockwise, then shifted."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return [(by[0] + c * x + s * y, by[1] - s * x + c * y) for x, y in points]


def circle(at: Point, radius: float, kind: str = "") -> str:
    """Return a circle."""
    return f'<circle class="{kind}" cx="{at[0]:g}" cy="{at[1]:g}" r="{radius:g}"/>'


def box(at: Point, width: float, height: float, kind: str = "") -> str:
    """Return a rectangle by its upper left corner."""
    return f'<rect class="{kind}" x="{at[0]:g}" y="{at[1]:g}" width="{width:g}" height="{height:g}"/>'


def drawing(title: str, width: int, height: int, parts: Sequence[str]) -> str:
    """Return a whole drawing."""
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" class="drawing" viewBox="0 0 {width} {height}" '
            f'width="{width}" height="{height}">',
            f"<title>{title}</title>",
            _STYLE,
            *parts,
            "</svg>",
            "",
        ]
    )


def frames() -> str:
    """Draw the body frame from the side, and both frames from above."""
    rails = line([(20, 232), (330, 232)], "soft")
    car = line([(60, 120), (250, 120), (275, 150), (275, 205), (60, 205)], "body", closed=True)
    wheels = [circle((x, 218), 14) for x in (105, 230)]
    origin = (150.0, 165.0)
    side = [
        text((20, 28), "body frame, seen from the right", "head"),
        rails, car, *wheels,
        arrow(origin, (320, 165), "blue"), text((305, 155), "x forward", "blue middle"),
        arrow(origin, (150, 55), "blue"), text((158, 62), "z up", "blue"),
        circle(origin, 8), *(line(moved([(-5, -b), (5, b)], origin), "blue") for b in (5, -5)),
        text((140, 192), "y left,", "blue end"), text((150, 192), "into the sheet", "small"),
        text((20, 262), "origin: the vehicle reference point", "small"),
    ]  # fmt: skip
    corner, centre, yaw = (400.0, 225.0), (545.0, 150.0), 32.0
    outline = moved([(-60, -17), (45, -17), (60, 0), (45, 17), (-60, 17)], centre, yaw)
    forward, left = moved([(125, 0), (0, -85)], centre, yaw)
    plan = [
        text((380, 28), "navigation frame, seen from above", "head"),
        arrow(corner, (470, 225)), text((474, 230), "x east"),
        arrow(corner, (400, 150)), text((392, 140), "y north"),
        circle(corner, 7), circle(corner, 2), text((386, 250), "z up, out of the sheet", "small"),
        line(outline, "body", closed=True),
        arrow(centre, forward, "blue"), text((forward[0] - 2, forward[1] - 10), "x forward", "blue middle"),
        arrow(centre, left, "blue"), text((left[0] - 4, left[1] - 6), "y left", "blue middle"),
        line([centre, (690, 150)], "dashed"), text((694, 168), "east", "small end"),
        turn(centre, 95, 0, yaw), text((650, 130), "yaw", "orange"),
    ]  # fmt: skip
    return drawing(
        "Body frame: x forward, y left, z up; navigation frame: x east, y north, z up", 720, 275, side + plan
    )


def signs() -> str:
    """Draw what is positive: roll and cross-level, gradient and pitch, curvature and versine, twist."""
    behind, tilt = (120.0, 150.0), -8.0
    rail = [(-7, -14), (7, -14), (7, 0), (-7, 0)]
    across = [
        text((20, 28), "roll, cross-level", "head"), text((20, 46), "seen from behind", "small"),
        line(moved([(-50, -80), (50, -80), (50, -16), (-50, -16)], behind, tilt), "body", closed=True),
        line(moved([(-85, 0), (85, 0)], behind, tilt)),
        *(line(moved(rail, moved([(x, 0)], behind, tilt)[0], tilt), "body", closed=True) for x in (-55, 55)),
        line([(20, 164), (220, 164)], "dashed"),
        turn(behind, 100, 66, 38), text((206, 80), "roll &gt; 0", "orange"),
        text((20, 200), "left rail higher: cross-level &gt; 0"),
    ]  # fmt: skip
    place, slope = (530.0, 150.0), 9.0
    along = [
        text((380, 28), "gradient, pitch", "head"), text((380, 46), "seen from the right", "small"),
        line(moved([(-110, 0), (120, 0)], place, slope)),
        line(moved([(-60, -62), (45, -62), (60, -42), (60, -12), (-60, -12)], place, slope), "body", closed=True),
        *(circle(moved([(x, -8)], place, slope)[0], 8) for x in (-38, 38)),
        line([(420, 167), (660, 167)], "dashed"),
        arrow(*moved([(62, -34), (120, -34)], place, slope), "blue"), text((650, 92), "x", "blue"),
        turn((place[0], place[1] - 30), 92, 60, 32), text((618, 62), "pitch &gt; 0", "orange"),
        text((380, 200), "uphill: gradient &gt; 0, and the pitch is negative"),
    ]  # fmt: skip
    bend = [(60 + 150 * math.sin(math.radians(a)), 220 + 150 * math.cos(math.radians(a))) for a in range(-5, 66, 2)]
    curve = [
        text((20, 248), "curvature, alignment", "head"), text((20, 266), "seen from above", "small"),
        line(bend, "blue"), tip(bend[-1], -math.radians(62), "blue"),
        text((205, 352), "left-hand curve:"), text((205, 372), "curvature &gt; 0,"), text((205, 392), "versine &lt; 0"),
        arrow((92, 366), (75, 325), "orange"), text((20, 300), "to the left: u &gt; 0", "orange"),
    ]  # fmt: skip
    base = [(400 + 2.4 * x, 360 - 0.55 * max(0.0, min(x - 30, 60))) for x in range(0, 121, 2)]
    twist = [
        text((380, 248), "twist", "head"), text((380, 266), "cross-level over the chainage", "small"),
        line(base, "blue"), arrow((400, 375), (700, 375)), text((700, 392), "chainage", "small end"),
        line([(490, 375), (490, 300)], "dashed"), line([(550, 375), (550, 300)], "dashed"),
        text((520, 369), "base", "small middle"),
        text((470, 290), "twist &gt; 0 where it rises", "orange"),
    ]  # fmt: skip
    return drawing("What is positive", 720, 410, across + along + curve + twist)


def versine() -> str:
    """Draw the versine of a right-hand curve from above, or of a crest from the side."""
    half, rise = 250.0, 0.0016
    track = [(360 + x, 60 + rise * x * x) for x in range(-330, 331, 10)]
    ends = [(360 + x, 60 + rise * half * half) for x in (-half, half)]
    middle = ((ends[0][0] + ends[1][0]) / 2, ends[0][1])
    parts = [
        line(track, "blue"), tip(track[-1], math.atan2(2 * rise * 330, 1.0), "blue"),
        text((60, 130), "track", "blue"),
        line(ends), *(circle(end, 5) for end in ends), text((150, 176), "chord of 10 m"),
        arrow(middle, (360, 62), "orange"), text((370, 118), "versine", "orange"),
        *(line([(x, y + 12), (x, 208)], "dashed") for x, y in [ends[0], middle, ends[1]]),
        text((ends[0][0], 226), "x - 5", "middle small"), text((360, 226), "x", "middle small"),
        text((ends[1][0], 226), "x + 5", "middle small"),
        text((360, 30), "v(x) = y(x) - (y(x - 5) + y(x + 5)) / 2", "middle"),
        text((360, 252), "positive where the track is above its chord, or to the left of it", "small middle"),
    ]  # fmt: skip
    return drawing("Versine: offset of the track from the middle of a chord", 720, 265, parts)


def graph() -> str:
    """Draw the graph: keyframes in a row, factors between neighbours, factors of one keyframe, shared variables."""
    xs = [90.0 + 135 * i for i in range(5)]
    parts = [line([(90, 66), (630, 66)], "soft")]
    for left, right in itertools.pairwise(xs):
        between = (left + right) / 2
        parts += [
            line([(left, 170), (right, 170)]), box((between - 7, 163), 14, 14),
            line([(left, 170), (between, 215), (right, 170)]), box((between - 7, 208), 14, 14),
            line([(between, 215), (between, 66)], "soft"),
            text((between + 12, 158), "IMU", "small"), text((between, 240), "wheel", "middle small"),
        ]  # fmt: skip
    below = {0: "standstill", 1: "fix", 3: "fix", 4: "GNSS"}
    for i, x in enumerate(xs):
        if i in below:
            parts += [line([(x, 170), (x, 262)]), box((x - 7, 255), 14, 14), text((x, 288), below[i], "middle small")]
        parts += [circle((x, 170), 24), text((x, 175), f"x{i}", "middle")]
    states = "states at a keyframe: pose, velocity, biases, distance, wheel scale"
    factor = "factor: one measurement or assumption of the states it is tied to"
    parts += [
        box((250, 42), 220, 48, "area"), text((360, 62), "shared variables", "middle head"),
        text((360, 80), "mounting, clock, calibration", "middle small"),
        circle((60, 322), 9), text((76, 327), states, "small"),
        box((52, 340), 14, 14), text((76, 352), factor, "small"),
    ]  # fmt: skip
    return drawing("Factor graph of a run", 720, 370, parts)


def lag() -> str:
    """Draw a fixed lag: what is marginalised, the window, the filtered and the smoothed row."""
    xs = [70.0 + 52 * i for i in range(12)]
    begin, now = xs[6] - 26, xs[-1]
    parts = [
        box((begin, 60), now + 26 - begin, 100, "area"),
        text(((begin + now) / 2, 50), "window: estimated together", "middle head"),
        text((xs[0] - 20, 50), "marginalised: eliminated, kept as a prior", "small"),
        line([(xs[0], 110), (now, 110)], "soft"),
        *(circle((x, 110), 12) for x in xs),
        arrow((40, 200), (700, 200)), text((700, 218), "time", "small end"),
        line([(now, 130), (now, 200)], "dashed"), text((now - 8, 218), "now", "end"),
        line([(xs[6], 130), (xs[6], 200)], "dashed"), text((xs[6] - 8, 218), "now - lag", "end"),
        arrow((now, 122), (now, 258), "orange"), text((now, 276), "filtered row, at once", "orange end"),
        arrow((xs[6], 122), (xs[6], 258), "blue"), text((xs[6], 276), "smoothed row, after the lag", "blue middle"),
        arrow((xs[5], 92), (begin + 14, 92)), text((xs[5] - 4, 88), "prior", "small end"),
    ]  # fmt: skip
    return drawing("Fixed-lag smoothing", 720, 290, parts)


DRAWINGS = {"frames": frames, "signs": signs, "versine": versine, "graph": graph, "lag": lag}


def main() -> int:
    """Write the drawings, or compare them with what is there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; exit status 1 if one has changed")
    check, stale = parser.parse_args().check, []
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, draw in DRAWINGS.items():
        path, svg = FOLDER / f"{name}.svg", draw()
        if check and (not path.exists() or path.read_text(encoding="utf-8") != svg):
            stale.append(name)
        elif not check:
            path.write_text(svg, encoding="utf-8")
    if stale:
        print(f"stale: {', '.join(stale)}; python tools/drawings.py draws them", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
