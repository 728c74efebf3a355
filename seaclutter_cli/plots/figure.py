"""Rendering of figures to files without a display; the same content gives the same bytes."""

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seaclutter_cli.errors import UsageError, requiring

if TYPE_CHECKING:
    from collections.abc import Callable

_SETTINGS: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    **dict.fromkeys(("font.size", "axes.labelsize"), 8),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize", "legend.fontsize"), 7),
    **dict.fromkeys(("axes.linewidth", "xtick.major.width", "ytick.major.width"), 0.6),
    **dict.fromkeys(("axes.grid", "legend.frameon"), False),
    "lines.linewidth": 1.2,
    "savefig.bbox": None,
    "svg.fonttype": "path",
    "svg.hashsalt": "seaclutter",
}
_METADATA: dict[str, dict[str, None]] = {".png": {"Software": None}, ".svg": {"Date": None, "Creator": None}}
_COLUMN_INCHES = 3.5
"""Width of a text column, and of all figures."""
_DPI = 300


def check_target(path: Path) -> None:
    """Check that a figure can be written to a file of this name; call it before the figure is computed.

    `UsageError` if the extension is not ``.png`` or ``.svg``, `MissingExtraError` if matplotlib is not installed.
    """
    if path.suffix.lower() not in _METADATA:
        raise UsageError(f"{path}: figure files must end in {' or '.join(_METADATA)}")
    with requiring("plotting", "plot"):
        import matplotlib.figure  # noqa: F401 - availability check


def render(draw: "Callable[..., None]", suffix: str, *, aspect: float = 0.68, **content: Any) -> bytes:
    """Return a figure, in which a function draws its content, as the bytes of a ``.png`` or ``.svg`` file."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    stream = io.BytesIO()
    with mpl.rc_context(_SETTINGS):
        figure = Figure(figsize=(_COLUMN_INCHES, _COLUMN_INCHES * aspect), layout="constrained")
        draw(figure, **content)
        kind = suffix.lower()
        figure.savefig(stream, format=kind[1:], dpi=_DPI, metadata=_METADATA[kind])
    return stream.getvalue()
