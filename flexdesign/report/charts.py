"""Line drawings for reports, as SVG that reads on light and on dark paper."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Mapping, Sequence
from typing import Any

from flexdesign.core import units

#: A grey that stands out on white and on black alike, for lines. Letters in it are darker on white, lighter on black.
NEUTRAL = "#8a949e"
_LETTERS = f"""</style>
  <style type="text/css">
   g[style^="fill: {NEUTRAL}"] {{ fill: #5c6670 !important }}
   @media (prefers-color-scheme: dark) {{ g[style^="fill: {NEUTRAL}"] {{ fill: #a5afb9 !important }} }}
  </style>""".encode()
#: Width of a drawing on the page, and the smallest letters there [px]; report.html has the same width.
PAGE, SMALLEST = 704.0, 11.0
#: Width of a drawing that a telephone shows whole, with letters of 9 pixels [inch].
NARROW = 5.5
#: What of a coordinate is too fine to see.
_SURPLUS = re.compile(rb"(\.\d\d)\d+")
COLOURS = ("#0b84b5", "#e0702c", "#3f9c4d", "#b0529e", "#c9a227", "#6d7cce", "#8d6e63", "#5f9ea0", "#d0506a", "#9aa5af")


def shares(split: Mapping[str, Mapping[str, float]], label: str, width: float = 7.2) -> bytes:
    """Draw stacked bars: of each name, how much each piece has; `width` in inches."""
    figure, axes = drawing(width, 0.55 * len(split) + 1.7)
    pieces = list(dict.fromkeys(piece for row in split.values() for piece in row))
    for position, row in enumerate(split.values()):
        left, right = 0.0, 0.0
        for piece in pieces:
            value = row.get(piece, 0.0)
            start = right if value >= 0 else left
            colour = COLOURS[pieces.index(piece) % len(COLOURS)]
            axes.barh(position, value, left=start, color=colour, height=0.62, label=piece if position == 0 else None)
            right, left = right + max(value, 0.0), left + min(value, 0.0)
    axes.set_yticks(range(len(split)), list(split))
    axes.invert_yaxis()
    axes.set_xlabel(label)
    below(figure, axes, 3)
    return svg(figure)


def spoken(split: Mapping[str, Mapping[str, int]]) -> str:
    """Return stacked bars of counts in words.

    >>> spoken({"first": {"agrees": 2, "differs": 0}, "second": {"agrees": 1, "differs": 3}})
    'first: 2 agrees; second: 1 agrees, 3 differs.'
    """
    rows = [f"{name}: {', '.join(f'{n} {piece}' for piece, n in row.items() if n)}" for name, row in split.items()]
    return f"{'; '.join(rows)}."


def lines(curves: Sequence[tuple[str, Sequence[float], Sequence[float]]], xlabel: str, ylabel: str) -> bytes:
    """Draw labelled curves over common axes."""
    figure, axes = drawing(NARROW, 3.6)
    for index, (label, x, y) in enumerate(curves):
        axes.plot(x, y, color=COLOURS[index], marker="o", label=label, linewidth=2)
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    axes.grid(color=NEUTRAL, alpha=0.25)
    below(figure, axes, 3 if max(len(label) for label, _, _ in curves) < 20 else 1)
    return svg(figure)


def drawing(width: float, height: float) -> tuple[Any, Any]:
    """Return an empty drawing of a size in inches, and its axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.add_subplot()
    plain(axes)
    return figure, axes


def plain(axes: Any) -> None:
    """Draw axes in a grey that reads on light and on dark paper, and without a box."""
    axes.patch.set_alpha(0.0)
    for spine in axes.spines.values():
        spine.set_color(NEUTRAL)
    axes.tick_params(which="both", colors=NEUTRAL)
    axes.xaxis.label.set_color(NEUTRAL)
    axes.yaxis.label.set_color(NEUTRAL)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def below(figure: Any, axes: Any, columns: int) -> None:
    """Name the curves of some axes below the drawing."""
    handles, labels = axes.get_legend_handles_labels()
    place = {"loc": "outside lower center", "frameon": False, "fontsize": 9, "labelcolor": NEUTRAL}
    figure.legend(handles, labels, ncols=columns, **place)


def _as_written(figure: Any) -> None:
    """Let names with $ in them stand as they are, and write units as they are set; numbers on axes stay."""
    from matplotlib.text import Text
    from matplotlib.ticker import FixedFormatter, FuncFormatter

    numbers = set[Text]()
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        numbers.add(axis.get_offset_text())
        if not isinstance(axis.get_major_formatter(), (FixedFormatter, FuncFormatter)):
            numbers |= {*axis.get_ticklabels(), *axis.get_ticklabels(minor=True)}
    for text in figure.findobj(Text):
        text.set_parse_math(text in numbers)
        if text not in numbers:
            text.set_text(units.typeset(text.get_text()))


def _legible(figure: Any) -> None:
    """Make letters so large that they are read where the page makes a wide drawing smaller."""
    from matplotlib.text import Text

    smallest = SMALLEST * 72.0 * figure.get_figwidth() / PAGE
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if axis.get_ticklabels() and axis.get_ticklabels()[0].get_fontsize() < smallest:
                axis.set_tick_params(which="both", labelsize=smallest)
    for text in figure.findobj(Text):
        text.set_fontsize(max(text.get_fontsize(), smallest))


def svg(figure: Any) -> bytes:
    """Return a drawing as SVG that is the same in every run; hundredths of a point are finer than any screen."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    _as_written(figure)
    _legible(figure)
    if (layout := figure.get_layout_engine()) is not None:
        # Laid out here, or everything would be drawn once more, unseen, before it is.
        FigureCanvasSVG(figure)
        layout.execute(figure)
        figure.set_layout_engine("none")
    sentences = {"Date": None, "Description": units.typeset(describe(figure))}
    stream = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "flexdesign", "path.simplify_threshold": 0.2}):
        figure.savefig(stream, format="svg", transparent=True, metadata=sentences)
    drawn = stream.getvalue().replace(b"</style>", _LETTERS, 1)
    return re.sub(rb' d="[^"]*"', lambda path: _SURPLUS.sub(rb"\1", path[0]), drawn)


def describe(figure: Any) -> str:
    """Say what a drawing shows, for who cannot see it: the axes with their ranges, and the curves or bars."""
    return " ".join(text for axes in figure.axes if (text := _describe_axes(axes)))


def _describe_axes(axes: Any) -> str:
    names = (axes.get_title(loc="left") or axes.get_title(), axes.get_ylabel(), axes.get_xlabel())
    title, ylabel, xlabel = (" ".join(name.split()) for name in names)
    shown = " over ".join(each for each in (ylabel, xlabel) if each)
    texts = [f"{title}: {shown}" if title and shown else title or shown]
    lines = [line for line in axes.get_lines() if not line.get_label().startswith("_") and len(line.get_ydata())]
    across = _has_names(axes.yaxis)  # the places of rows are no values
    texts += [f"{line.get_label()} {_span(line.get_xdata() if across else line.get_ydata())}" for line in lines]
    bars = [patch for patch in axes.patches if hasattr(patch, "get_height")]
    if not lines and bars:
        texts.append(f"{len(bars)} bars")
    named = [
        label.get_text() for axis in (axes.xaxis, axes.yaxis) for label in _category_labels(axis) if label.get_text()
    ]
    if named:
        texts.append(", ".join(" ".join(name.split()) for name in named))
    texts = [text for text in texts if text]
    return f"{'; '.join(texts)}." if texts else ""


def _category_labels(axis: Any) -> Sequence[Any]:
    """Return the labels of an axis that has names in place of numbers."""
    return axis.get_ticklabels() if _has_names(axis) else ()


def _has_names(axis: Any) -> bool:
    """Tell whether `set_ticks` gave an axis labels, instead of numbers."""
    from matplotlib.ticker import FixedFormatter, FixedLocator, FuncFormatter

    return isinstance(axis.get_major_locator(), FixedLocator) and isinstance(
        axis.get_major_formatter(), (FixedFormatter, FuncFormatter)
    )


def _span(values: Any) -> str:
    import numpy as np

    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    if not finite.size:
        return "without values"
    low, high = f"{finite.min():.3g}", f"{finite.max():.3g}"
    return f"at {low}" if low == high else f"from {low} to {high}"


def is_narrow(drawing: bytes) -> bool:
    """Tell whether an SVG is so narrow that a narrow window shows it whole."""
    found = re.search(rb'width="([\d.]+)pt"', drawing[:1000])
    return found is not None and float(found[1]) <= 72.0 * NARROW


def description(drawing: bytes) -> str:
    """Return what an SVG says of itself; empty for other pictures.

    >>> figure, axes = drawing(3.0, 2.0)
    >>> axes.set_xlabel("time [s]"), axes.plot([0, 1], [2, 3], label="x") and None
    (Text(0.5, 0, 'time [s]'), None)
    >>> description(svg(figure))
    'time [s]; x from 2 to 3.'
    """
    found = re.search(rb"<dc:description>(.*?)</dc:description>", drawing[:4000], re.DOTALL)
    return html.unescape(found[1].decode()) if found else ""
