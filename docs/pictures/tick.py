"""Draws docs/pictures/tick.svg: the messages of one tick of a world that a simulator and a worker have joined.

python docs/pictures/tick.py
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

PARTS = ("vehicle simulator", "service", "SUMO and criteria", "worker")
MESSAGES = (
    (0, 1, "step: tick 7, pose, its actors"),
    (3, 1, "step: tick 7, action"),
    (1, 2, "once all have sent theirs"),
    (2, 2, "0.1 s: drive, yield, see, judge"),
    (2, 1, "tick 8: observations, egos, traffic"),
    (1, 0, "reply: tick 8, egos and traffic"),
    (1, 3, "reply: tick 8, observations"),
)
LEFT, APART, TOP, STEP = 110, 250, 40, 46
WIDTH, HEIGHT = 2 * LEFT + APART * (len(PARTS) - 1) + 120, TOP + STEP * (len(MESSAGES) + 1)
STYLE = """text{font:14px ui-sans-serif,system-ui,sans-serif;fill:#1F2328}.page{fill:#FAF8F4}
text{stroke:#FAF8F4;stroke-width:4;paint-order:stroke}
.part{font-weight:700}.line{stroke:#B4AC9D;stroke-width:1.5}.arrow{stroke:#5B4B8A;stroke-width:2;fill:none}
.head{fill:#5B4B8A}@media(prefers-color-scheme:dark){text{fill:#E8E6E1;stroke:#14161A}.page{fill:#14161A}.line{stroke:#464C55}
.arrow{stroke:#A594E0}.head{fill:#A594E0}}"""


def parts() -> Iterator[str]:
    """Name and line of each part."""
    for number, name in enumerate(PARTS):
        x = LEFT + APART * number
        yield f'<text class="part" x="{x}" y="24" text-anchor="middle">{name}</text>'
        yield f'<line class="line" x1="{x}" y1="{TOP}" x2="{x}" y2="{HEIGHT - 16}"/>'


def messages() -> Iterator[str]:
    """Arrow and words of each message, in the order of time."""
    for number, (source, target, words) in enumerate(MESSAGES, start=1):
        y, x0, x1 = TOP + STEP * number, LEFT + APART * source, LEFT + APART * target
        if source == target:
            yield f'<path class="arrow" d="M{x0} {y - 8}h18v16h-14"/><path class="head" d="M{x0 + 2} {y + 8}l9-5v10z"/>'
            yield f'<text x="{x0 + 26}" y="{y + 5}">{words}</text>'
            continue
        tip = 9 if x1 < x0 else -9
        yield f'<line class="arrow" x1="{x0}" y1="{y}" x2="{x1 + tip}" y2="{y}"/>'
        yield f'<path class="head" d="M{x1} {y}l{tip}-5v10z"/>'
        anchor = f'x="{x0 + 8}"' if x1 > x0 else f'x="{x0 - 8}" text-anchor="end"'
        yield f'<text {anchor} y="{y - 8}">{words}</text>'


def main() -> None:
    """Writes the picture."""
    label = "The messages of one tick, in the order of time"
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">'
    page = f'<rect class="page" width="{WIDTH}" height="{HEIGHT}" rx="8"/>'
    lines = [head, f"<style>{STYLE}</style>", page, *parts(), *messages(), "</svg>"]
    Path(__file__).with_suffix(".svg").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
