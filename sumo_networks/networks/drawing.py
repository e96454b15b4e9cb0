"""Drawing: a network as a road map, in SVG (and HTML around it) or as a PNG picture.

A map is a list of shapes in metres, bottom first; one painter writes SVG, another PNG.
"""

from __future__ import annotations

import html
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely
import shapely.ops
from PIL import Image, ImageDraw, ImageFont

from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.entries import is_mirrored
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.units import KMH_PER_MPS

WIDEST_PX = 3200
LARGEST_SCALE = 6.0
MARGIN_M = 12.0
MARKING_M = 0.14
SMALLEST_LINE_PX = 0.6
DETAIL_FROM_PX_PER_M = 1.1
DARKER_BELOW_PX_PER_M = 2.2
SUPERSAMPLING = 2
TEXT_PX = 20
STRIP_PX = 3 * TEXT_PX

LIGHT = {
    "page": "#FAF8F4",
    "lane": "#D9D4CA",
    "far": "#BDB5A6",
    "other": "#E2DED4",
    "foot": "#EDE9E0",
    "stripe": "#FFFFFF",
    "marking": "#FFFFFF",
    "edge": "#B4AC9D",
    "stop": "#1F2328",
    "light": "#5B4B8A",
    "sign": "#B3362E",
    "ink": "#1F2328",
    "quiet": "#6B7280",
}
DARK = {
    "page": "#14161A",
    "lane": "#2A2E35",
    "far": "#4A515B",
    "other": "#23272D",
    "foot": "#1F2329",
    "stripe": "#8B919B",
    "marking": "#8B919B",
    "edge": "#464C55",
    "stop": "#E8E6E1",
    "light": "#A594E0",
    "sign": "#E0776F",
    "ink": "#E8E6E1",
    "quiet": "#9AA3AF",
}


@dataclass(frozen=True, slots=True)
class Shape:
    """One filled polygon.

    Attributes:
        role: Key of the polygon's colour.
        outline: (P, 2), m, corners in the network frame.
        title: Text shown under the mouse pointer; "" for none.
        kind: Kind of the object it shows: "lane", "crossing", "light" or "stop-sign"; "" for decoration.
        name: SUMO id of the object.
    """

    role: str
    outline: FloatArray
    title: str = ""
    kind: str = ""
    name: str = ""


@dataclass(frozen=True)
class RoadMap:
    """A drawn network.

    Attributes:
        name: Name of the network.
        caption: One line of facts.
        bounds: Smallest x, smallest y, largest x, largest y, m.
        scale: Pixels per metre of the picture.
        shapes: Polygons, bottom first.
        lanes: Length of each lane on which a mission can begin or end, m, then x, y of its centreline, m, by its id.
    """

    name: str
    caption: str
    bounds: tuple[float, float, float, float]
    scale: float
    shapes: list[Shape] = field(default_factory=list)
    lanes: dict[str, list[float]] = field(default_factory=dict)

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the picture."""
        x0, y0, x1, y1 = self.bounds
        return math.ceil((x1 - x0) * self.scale), math.ceil((y1 - y0) * self.scale)


def write_map(network: RoadNetwork, path: Path) -> Path:
    """Draws a network into a file.

    Args:
        network: The roads.
        path: File to write; it ends in .png, .svg or .html.

    Raises:
        InvalidInputError: The path has another ending, or the file cannot be written.
    """
    painters = {".svg": _svg_file, ".html": _html_file, ".png": _png_file}
    if path.suffix.lower() not in painters:
        raise InvalidInputError(f"'{path}': expected a file that ends in .png, .svg or .html")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        painters[path.suffix.lower()](draw_map(network), path)
    except OSError as error:
        raise InvalidInputError(f"cannot write '{path}': {error.strerror or error}") from error
    return path


def draw_map(network: RoadNetwork) -> RoadMap:
    """The map of a network as shapes; left-hand traffic, driven in its mirror image, is drawn as the place is."""
    x0, y0, x1, y1 = network.bounds
    bounds = (x0 - MARGIN_M, y0 - MARGIN_M, x1 + MARGIN_M, y1 + MARGIN_M)
    scale = min(WIDEST_PX / max(bounds[2] - bounds[0], bounds[3] - bounds[1]), LARGEST_SCALE)
    lanes = network.lanes
    road = lanes.drivable & ~lanes.internal
    counts = {"light": len(network.signals.light_ids), "crossing": int(lanes.crossing.sum())}
    facts = [f"{count} {what}{'' if count == 1 else 's'}" for what, count in counts.items()]
    caption = " · ".join([f"{lanes.length[road].sum() / 1000:.1f} km of lanes", *facts])
    shapes, places = list(_shapes(network, scale)), _places(network, road)
    if is_mirrored(network.name):
        bounds = (-bounds[2], bounds[1], -bounds[0], bounds[3])
        shapes = [replace(shape, outline=shape.outline * (-1.0, 1.0)) for shape in shapes]
        places = {lane: line * (-1.0, 1.0) for lane, line in places.items()}
    lines = {
        str(lanes.ids[lane]): [round(float(lanes.length[lane]), 2), *np.round(line, 2).ravel().tolist()]
        for lane, line in places.items()
    }
    return RoadMap(network.name, caption, bounds, scale, shapes, lines)


def _places(network: RoadNetwork, road: BoolArray) -> dict[int, FloatArray]:
    """Centrelines of the lanes on which a mission can begin or end."""
    return {lane: network.lane_shape(lane) for lane in np.flatnonzero(road).tolist()}


def _shapes(network: RoadNetwork, scale: float) -> Iterator[Shape]:
    yield from _ground(network, scale)
    yield from _roads(network, scale)
    if scale >= DETAIL_FROM_PX_PER_M:
        yield from _markings(network, scale)
    yield from _crossings(network, scale)
    yield from _stop_lines(network, scale)


def _ground(network: RoadNetwork, scale: float) -> Iterator[Shape]:
    """Junctions, and on top of them the lanes for pedestrians, for bicycles only or for trains."""
    lanes = network.lanes
    for junction in range(len(network.junctions.ids)):
        outline = network.junction_shape(junction)
        if len(outline) >= 3:
            yield Shape(_road_role(scale), outline, f"junction {network.junctions.ids[junction]}")
    for lane in np.flatnonzero(~lanes.drivable & ~lanes.crossing).tolist():
        shape, inside = network.lane_shape(lane), str(lanes.ids[lane]).startswith(":")
        role = "foot" if lanes.pedestrian[lane] else "other"
        if inside and lanes.pedestrian[lane] and not lanes.internal[lane] and len(shape) > 2:
            yield Shape(role, shape)  # a walking area: its shape is its outline
        elif not inside:
            yield from _band(role, shape, lanes.width[lane], scale)


def _road_role(scale: float) -> str:
    return "lane" if scale >= DARKER_BELOW_PX_PER_M else "far"


def _roads(network: RoadNetwork, scale: float) -> Iterator[Shape]:
    lanes = network.lanes
    drivable = np.flatnonzero(lanes.drivable)
    for lane in sorted(drivable.tolist(), key=lambda i: not lanes.internal[i]):
        role = _road_role(scale)
        name = str(lanes.ids[lane])
        title = f"{name} · {lanes.length[lane]:.0f} m · {lanes.speed[lane] * KMH_PER_MPS:.0f} km/h"
        for number, shape in enumerate(_band(role, network.lane_shape(lane), lanes.width[lane], scale)):
            yield Shape(role, shape.outline, title, "" if number else "lane", name)


def _markings(network: RoadNetwork, scale: float) -> Iterator[Shape]:
    """Lane markings: dashed between lanes of one direction, solid on the far left, and a kerb on the right."""
    lanes = network.lanes
    for lane in np.flatnonzero(lanes.drivable & ~lanes.internal).tolist():
        line = shapely.linestrings(network.lane_shape(lane))
        half = float(lanes.width[lane]) / 2
        if lanes.right[lane] < 0:
            yield from _line("edge", _points(shapely.offset_curve(line, -half)), MARKING_M, scale)
        left = _points(shapely.offset_curve(line, half))
        if lanes.left[lane] < 0:
            yield from _line("marking", left, MARKING_M, scale)
        else:
            for dash in _dashes(left, 3.0, 6.0):
                yield from _line("marking", dash, MARKING_M, scale)


def _crossings(network: RoadNetwork, scale: float) -> Iterator[Shape]:
    lanes = network.lanes
    for lane in np.flatnonzero(lanes.crossing).tolist():
        shape, name = network.lane_shape(lane), str(lanes.ids[lane])
        stripes = list(_dashes(shape, 0.5, 1.0)) if scale >= DETAIL_FROM_PX_PER_M else [shape]
        for number, stripe in enumerate(stripes):
            for part in _band("stripe", stripe, float(lanes.width[lane]), scale):
                yield Shape("stripe", part.outline, f"crossing {name}", "" if number else "crossing", name)


def _stop_lines(network: RoadNetwork, scale: float) -> Iterator[Shape]:
    """Stop lines; with a disc (traffic light) or an octagon (stop sign) at the right end."""
    radius = max(1.1, 2.2 / scale)
    lines = network.stop_lines
    for row in range(len(lines.lane)):
        right, left = lines.segment[row].reshape(2, 2)
        along = np.array([-(left - right)[1], (left - right)[0]]) / max(np.hypot(*(left - right)), 1e-9)
        if scale >= DETAIL_FROM_PX_PER_M:
            yield from _line("stop", np.array([right, left]) + along * 0.3, 0.45, scale)
        centre = right + (right - left) / max(np.hypot(*(left - right)), 1e-9) * radius
        lane = str(network.lanes.ids[lines.lane[row]])
        if lines.lit[row]:
            yield Shape("light", _polygon(centre, radius, 16), f"light at {lane}", "light", lane)
        elif lines.stop_sign[row]:
            yield Shape("sign", _polygon(centre, 1.3 * radius, 8), f"stop sign at {lane}", "stop-sign", lane)


def _polygon(centre: FloatArray, radius: float, corners: int) -> FloatArray:
    angle = (np.arange(corners) + 0.5) * 2 * np.pi / corners
    return centre + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _line(role: str, points: FloatArray, width: float, scale: float) -> Iterator[Shape]:
    yield from _band(role, points, max(width, SMALLEST_LINE_PX / scale), scale)


def _band(role: str, points: FloatArray, width: float, scale: float) -> Iterator[Shape]:
    """Polygons of a line with a width; thin lines are widened so that they stay visible."""
    if len(points) < 2 or not np.ptp(points, axis=0).any():
        return
    half = max(float(width), 1.0 / scale) / 2
    area = shapely.buffer(shapely.linestrings(points), half, cap_style="flat", quad_segs=4)
    for part in shapely.get_parts(area):
        if not part.is_empty:
            yield Shape(role, shapely.get_coordinates(part.exterior))


def _points(geometry: shapely.Geometry) -> FloatArray:
    """(P, 2) points of the longest part of a line; an offset line may have several parts in tight bends."""
    parts = shapely.get_parts(geometry)
    return np.asarray(shapely.get_coordinates(parts[int(np.argmax(shapely.length(parts)))] if len(parts) else None))


def _dashes(points: FloatArray, on: float, period: float) -> Iterator[FloatArray]:
    if len(points) < 2:
        return
    line = shapely.linestrings(points)
    length = float(shapely.length(line))
    for start in np.arange((length % period) / 2, length - on + 1e-9, period).tolist():
        dash = shapely.ops.substring(line, start, start + on)
        yield np.asarray(shapely.get_coordinates(dash))


def _scale_bar(road_map: RoadMap) -> float:
    """Length of the scale bar, m: a round number, about a sixth of the map's width."""
    sixth = (road_map.bounds[2] - road_map.bounds[0]) / 6
    decade = 10.0 ** math.floor(math.log10(sixth))
    return max(step * decade for step in (1, 2, 5) if step * decade <= sixth)


def _svg_file(road_map: RoadMap, path: Path) -> None:
    path.write_text(svg(road_map), encoding="utf-8")


def svg(road_map: RoadMap) -> str:
    """The map as one SVG document; coordinates are metres, y downwards."""
    x0, y0, x1, y1 = road_map.bounds
    width, height = road_map.size_px
    unit = 1 / road_map.scale
    foot = STRIP_PX * unit
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{x0:.1f} {-y1:.1f} {x1 - x0:.1f} {y1 - y0 + foot:.1f}"',
        f' width="{width}" height="{height + STRIP_PX}" role="img"',
        f' aria-label="Road map of {html.escape(road_map.name)}">',
        f"<style>{_styles()}</style>",
        f'<rect class="page" x="{x0:.1f}" y="{-y1:.1f}" width="{x1 - x0:.1f}" height="{y1 - y0 + foot:.1f}"/>',
    ]
    out += [_svg_shape(shape) for shape in road_map.shapes]
    out += [*_svg_furniture(road_map), "</svg>", ""]
    return "\n".join(out)


def _styles() -> str:
    light = "".join(f".{role}{{fill:{colour}}}" for role, colour in LIGHT.items())
    dark = "".join(f".{role}{{fill:{colour}}}" for role, colour in DARK.items())
    return f"text{{font-family:ui-sans-serif,system-ui,sans-serif}}{light}@media(prefers-color-scheme:dark){{{dark}}}"


def _svg_shape(shape: Shape) -> str:
    points = " ".join(f"{x:.2f},{-y:.2f}" for x, y in shape.outline)
    data = f' data-{shape.kind}="{html.escape(shape.name)}"' if shape.kind else ""
    title = f"<title>{html.escape(shape.title)}</title>" if shape.title else ""
    return f'<polygon class="{shape.role}" points="{points}"{data}>{title}</polygon>'


def _svg_furniture(road_map: RoadMap) -> list[str]:
    """Scale bar, north arrow, name and facts, in a strip under the map."""
    x0, y0, x1, _ = road_map.bounds
    unit = 1 / road_map.scale
    bar, base = _scale_bar(road_map), -y0 + 2 * TEXT_PX * unit
    left, right = x0 + 16 * unit, x1 - 16 * unit

    def text(x: float, content: str, role: str, anchor: str) -> str:
        return (
            f'<text class="{role}" x="{x:.2f}" y="{base:.2f}" font-size="{TEXT_PX * unit:.2f}" text-anchor="{anchor}">'
            f"{html.escape(content)}</text>"
        )

    arrow = f"{right - 5 * unit:.2f},{base:.2f} {right:.2f},{base - 16 * unit:.2f} {right + 5 * unit:.2f},{base:.2f}"
    start = right - 30 * unit - bar
    return [
        text(left, f"{road_map.name}   {road_map.caption}", "ink", "start"),
        f'<rect class="ink" x="{start:.2f}" y="{base - 3 * unit:.2f}" width="{bar:.2f}" height="{3 * unit:.2f}"/>',
        text(start - 8 * unit, f"{bar:g} m", "quiet", "end"),
        f'<polygon class="ink" points="{arrow}"><title>north</title></polygon>',
        text(right - 12 * unit, "N", "quiet", "end"),
    ]


def _html_file(road_map: RoadMap, path: Path) -> None:
    """Writes the map as a page that shows lanes under the pointer, and gives starts and goals to copy."""
    lanes = json.dumps(road_map.lanes, separators=(",", ":")).replace("<", "\\u003c")
    page = Path(__file__).with_name("map_page.html").read_text(encoding="utf-8")
    for key, value in (("{name}", html.escape(road_map.name)), ("{lanes}", lanes), ("{svg}", svg(road_map))):
        page = page.replace(key, value, 1)
    path.write_text(page, encoding="utf-8")


def _png_file(road_map: RoadMap, path: Path) -> None:
    width, height = road_map.size_px
    x0, _, _, y1 = road_map.bounds
    scale = road_map.scale * SUPERSAMPLING
    image = Image.new("RGB", (width * SUPERSAMPLING, height * SUPERSAMPLING), LIGHT["page"])
    draw = ImageDraw.Draw(image)
    for shape in road_map.shapes:
        pixels = np.column_stack([(shape.outline[:, 0] - x0) * scale, (y1 - shape.outline[:, 1]) * scale])
        if len(pixels) >= 3:
            draw.polygon(list(map(tuple, pixels.tolist())), fill=LIGHT[shape.role])
    paper = Image.new("RGB", (width, height + STRIP_PX), LIGHT["page"])
    paper.paste(image.resize((width, height), Image.Resampling.LANCZOS), (0, 0))
    _png_furniture(road_map, paper)
    paper.save(path, optimize=True)


def _png_furniture(road_map: RoadMap, paper: Image.Image) -> None:
    draw, font = ImageDraw.Draw(paper), ImageFont.load_default(TEXT_PX)
    base, right, bar = paper.height - TEXT_PX, paper.width - 16, _scale_bar(road_map)
    start = right - 30 - bar * road_map.scale
    caption = f"{road_map.name}   {road_map.caption}".replace("·", "|")
    draw.text((16, base), caption, fill=LIGHT["ink"], font=font, anchor="ls")
    draw.rectangle((start, base - 3, start + bar * road_map.scale, base), fill=LIGHT["ink"])
    draw.text((start - 8, base), f"{bar:g} m", fill=LIGHT["quiet"], font=font, anchor="rs")
    draw.polygon([(right - 5, base), (right, base - 16), (right + 5, base)], fill=LIGHT["ink"])
    draw.text((right - 12, base), "N", fill=LIGHT["quiet"], font=font, anchor="rs")
