"""The gallery: every shape of the catalogue with pictures and facts, drawn whenever the docs are built."""

from __future__ import annotations

from functools import cache
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

from swarmer.shapes.catalogue import CATALOGUE, load_shape
from swarmer.shapes.cloud import PointCloud
from swarmer.shapes.drawing import GROUND, Panel, draw_clouds
from swarmer.shapes.neighbours import neighbour_plan
from swarmer.shapes.views import FRONT, SIDE, THREE_QUARTERS, View

FOLDER = "gallery"  # beside the page
IN_SPACE = {"three quarters": THREE_QUARTERS, "side": SIDE, "front": FRONT}
IN_THE_PLANE = {"flat": SIDE}
DPI = 120
GENERATORS = "swarmer/shapes/generators.py"

STYLE = f"""<style>
.gallery {{ display: grid; gap: .5rem; grid-template-columns: repeat(auto-fill, minmax(6.4rem, 1fr)); }}
.gallery a {{ color: inherit; font-size: .68rem; line-height: 1.35; text-align: center; }}
.gallery img, .shape img {{ aspect-ratio: 1; background: {GROUND}; border-radius: .3rem; display: block;
  object-fit: contain; width: 100%; }}
.gallery b, .gallery span {{ display: block; }}
.shape {{ margin-bottom: 2rem; }}
.shape .views {{ display: grid; gap: .5rem; grid-template-columns: repeat(3, 1fr); }}
.shape .views.alone {{ display: block; max-width: 20rem; }}
@media (max-width: 30em) {{
  .shape .views {{ grid-template-columns: repeat(2, 1fr); }}
  .shape figure:first-child {{ grid-column: 1 / -1; }}
}}
.shape figure {{ margin: 0; max-width: none; width: auto; }}
.shape figcaption {{ font-size: .64rem; font-style: normal; margin: .2rem 0 0; max-width: none; opacity: .75; }}
.shape dl {{ display: grid; font-size: .7rem; gap: .1rem 1rem; grid-template-columns: max-content 1fr;
  margin: .6rem 0 0; }}
.shape dt {{ opacity: .75; }}
.md-typeset .shape dl dd {{ margin: 0; overflow-wrap: anywhere; }}
</style>"""


@cache
def pictures() -> dict[str, bytes]:
    """Every picture of the page, as a PNG, by its path from the page."""
    drawn = {}
    with TemporaryDirectory() as folder:
        at = Path(folder) / "picture.png"
        for name in CATALOGUE:
            cloud = _cloud(name)
            for title, view in views(cloud).items():
                draw_clouds([Panel("", cloud.points, None, view)], at, dpi=DPI)
                drawn[path(name, title)] = at.read_bytes()
    return drawn


def path(name: str, title: str) -> str:
    """Where the picture of a shape lies, from the page."""
    return f"{FOLDER}/{name}-{title.replace(' ', '-')}.png"


def views(cloud: PointCloud) -> dict[str, View]:
    """From where a cloud is drawn, the picture that says most first."""
    return IN_THE_PLANE if cloud.dim == 2 else IN_SPACE


def tiles_html() -> str:
    """All shapes at a glance, each a link to its own part of the page."""
    tiles = "".join(_tile(name) for name in CATALOGUE)
    return f'{STYLE}\n<div class="gallery">{tiles}</div>'


def shapes_markdown() -> str:
    """A part of the page for each shape: its pictures, its facts."""
    return "\n\n".join(f"### {name} {{ #{name} }}\n\n{_shape_html(name)}" for name in CATALOGUE)


def maker(name: str) -> str:
    """The file of the checkout that makes the shape."""
    return f"scripts/solids/{name}.py" if CATALOGUE[name].make is None else GENERATORS


def facts(name: str) -> dict[str, str]:
    """What there is to know of a shape, as HTML."""
    entry, cloud = CATALOGUE[name], _cloud(name)
    plan = neighbour_plan(cloud.points)
    box = " × ".join(f"{round(extent, 1):g}" for extent in cloud.box_cells)
    return {
        "points": f"{len(cloud):,}"
        + ("" if entry.make is None else f", or any count: {escape(entry.about)}"),
        "box, L × H × D": f"{box} cells",
        "nearest two": f"{plan.spacing_min_cells:.2f} cells apart",
        f"parts at η = {plan.eta}": f"{plan.components}",
        "longest planned link": f"{plan.longest_link_cells:.1f} cells",
        "licence": escape(entry.licence + (f", {entry.credit}" if entry.credit else "")),
        "made by": f"<code>{maker(name)}</code>",
        "run it": f"<code>swarmer-run --shape {name}</code>",
    }


@cache
def _cloud(name: str) -> PointCloud:
    return load_shape(name)


def _tile(name: str) -> str:
    cloud = _cloud(name)
    first = next(iter(views(cloud)))
    return f'<a href="#{name}">{_image(name, first)}<b>{name}</b><span>{len(cloud):,}</span></a>'


def _shape_html(name: str) -> str:
    titles = list(views(_cloud(name)))
    figures = "".join(
        f"<figure>{_image(name, title)}<figcaption>{title}</figcaption></figure>" for title in titles
    )
    alone = " alone" if len(titles) == 1 else ""
    rows = "".join(f"<dt>{escape(what)}</dt><dd>{said}</dd>" for what, said in facts(name).items())
    return f'<div class="shape"><div class="views{alone}">{figures}</div><dl>{rows}</dl></div>'


def _image(name: str, title: str) -> str:
    return f'<img src="{path(name, title)}" alt="{name}, {title}" loading="lazy">'
