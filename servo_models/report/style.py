"""The look of the report: one palette for page and figures, light and dark.

A figure is drawn in the light colours; on the page each colour becomes the CSS variable
of its name, so that the same drawing follows the reader's colour scheme.  The series
colours are those of Okabe and Ito (2008), told apart by people with any colour vision;
lines differ in dash or carry their name as well.
"""

from __future__ import annotations

import io
import re
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from servo_models.report.sections import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


PALETTE = {
    "ink": ("#1d2329", "#e4e8ec"),
    "muted": ("#5a6570", "#a3adb8"),
    "grid": ("#dde2e7", "#363e47"),
    "shade": ("#f0f2f5", "#272e36"),
    "paper": ("#fdfdfc", "#171b20"),
    "blue": ("#0072b2", "#56b4e9"),
    "orange": ("#b54a05", "#f0954f"),
    "green": ("#007a5a", "#3fc79d"),
    "purple": ("#a2497f", "#df9cc4"),
}
"""Colours by name: (colour on a light page, colour on a dark page)."""

STYLE = re.compile(r'style="([^"]+)"')

SERIES = ("blue", "orange", "green", "purple")  # names of the colours of curves, in order

WIDTH = 4.2  # width of a figure [inch]; text of 9 points stays legible on a phone
WIDE = 5.5  # width [inch] from which a figure takes the whole page and scrolls on a phone


def colour(name: str) -> str:
    """Return the drawing colour of that name."""
    return PALETTE[name][0]


@contextmanager
def drawing(
    rows: int = 1, height: float = 2.7, shared: bool = True
) -> Iterator[tuple[Figure, list[Axes]]]:
    """Give a styled figure with ``rows`` axes, one above the other, of a ``height`` [inch]; they
    may have one time or frequency axis (``shared``)."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_settings()):
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        axes = figure.subplots(rows, 1, sharex=shared, squeeze=False)
        yield figure, list(axes[:, 0])


def figure(picture: Picture) -> Figure:
    """Return a picture of a section, drawn."""
    with drawing(picture.rows, picture.height, picture.shared) as (drawn, axes):
        if picture.width:
            drawn.set_figwidth(picture.width)
        picture.draw(axes)
        drawn.align_ylabels(axes)
        return drawn


def svg(figure: Figure, name: str, title: str, themed: bool = True) -> Markup:
    """Return a figure as inline SVG; the page's colours replace those drawn where ``themed``."""
    import matplotlib as mpl

    buffer = io.StringIO()
    with mpl.rc_context(_settings()):
        figure.savefig(buffer, format="svg")
    return _inline(buffer.getvalue(), name, title, themed)


def label(
    axes: Axes,
    at: tuple[float, float],
    text: str,
    series: str,
    shift: tuple[float, float] = (0.0, 0.0),
    align: str = "left",
) -> None:
    """Write ``text`` at a point in data coordinates and a ``shift`` [points], in a curve's colour;
    the page draws a halo around it."""
    axes.annotate(
        text,
        at,
        shift,
        textcoords="offset points",
        color=colour(series),
        ha=align,
        va="center",
        fontsize=8.5,
    ).set_in_layout(False)


def variables() -> str:
    """Return the palette as CSS, dark where the reader's screen prefers it."""
    light = " ".join(f"--{name}: {pair[0]};" for name, pair in PALETTE.items())
    dark = " ".join(f"--{name}: {pair[1]};" for name, pair in PALETTE.items())
    return (
        f":root {{ {light} }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}"
    )


def _settings() -> dict[Any, Any]:
    return {
        "axes.edgecolor": colour("muted"),
        "axes.facecolor": "none",
        "axes.grid": True,
        "axes.labelcolor": colour("ink"),
        "axes.labelsize": 9,
        "axes.linewidth": 0.7,
        "axes.spines.right": False,
        "axes.spines.top": False,
        "figure.facecolor": "none",
        "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans"],
        "font.size": 9,
        "grid.color": colour("grid"),
        "grid.linewidth": 0.6,
        "lines.linewidth": 1.6,
        "lines.markersize": 5,
        "lines.solid_capstyle": "round",
        "savefig.facecolor": "none",
        "svg.fonttype": "none",
        "svg.hashsalt": "servo-models",
        "text.color": colour("ink"),
        "xtick.color": colour("muted"),
        "xtick.labelsize": 8.5,
        "ytick.color": colour("muted"),
        "ytick.labelsize": 8.5,
    }


def _inline(text: str, name: str, title: str, themed: bool) -> Markup:
    """Turn matplotlib's SVG document into an element of the page."""
    size, content = text[text.index("viewBox=") :].rsplit("</svg>", 1)[0].split(">", 1)
    width, height = size.split('"')[1].split()[2:]
    content = re.sub(r"<(metadata|style).*?</\1>|<!--.*?-->", "", content, flags=re.S)
    content = re.sub(r"\s+", " ", content).replace("xlink:href", "href")
    used = set(re.findall(r'(?:url\(|href=")#([\w.-]+)', content))
    content = re.sub(
        r' id="([^"]+)"', lambda m: f' id="{name}-{m[1]}"' if m[1] in used else "", content
    )
    content = re.sub(r'(url\(|href=")#', rf"\g<1>#{name}-", content)
    content = re.sub(r' (d|x|y)="([^"]+)"', lambda m: f' {m[1]}="{_coarse(m[2])}"', content)
    for variable, (light, _) in PALETTE.items() if themed else ():
        content = content.replace(light, f"var(--{variable})")
    bare = 1
    while bare:  # groups that say nothing, from the innermost out
        content, bare = re.subn(r"<g> ?((?:(?!</?g\b).)*)</g> ?", r"\1", content)
    content = _classed(content)
    is_wide = float(width) > WIDE * 72.0
    wide = Markup(' class="wide" style="min-width: {}pt"').format(width) if is_wide else ""
    frame = Markup(
        '<svg{} viewBox="0 0 {} {}" role="img" aria-label="{}"><title>{}</title>{}</svg>'
    )
    return frame.format(wide, width, height, title, title, Markup(content))


def _classed(content: str) -> str:
    """Write each style once, as a class, where it is repeated: half of a figure is styles."""
    often = [text for text, times in Counter(STYLE.findall(content)).items() if times > 2]
    names = {text: f"s{zlib.crc32(text.encode()):x}" for text in often}
    rules = " ".join(f".{name} {{ {text} }}" for text, name in names.items())
    named = STYLE.sub(
        lambda m: f'class="{names[m[1]]}"' if m[1] in names else m[0],
        content,
    )
    return f"<style>{rules}</style>{named}"


def _coarse(path: str) -> str:
    """Drop what no screen shows: a hundredth of a point is enough for a curve."""
    return re.sub(r"(\.\d\d)\d+", r"\1", path)
