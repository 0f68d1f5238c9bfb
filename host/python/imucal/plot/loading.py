# SPDX-License-Identifier: MIT
"""matplotlib's parts, loaded without what nobody here reads."""
import contextlib
import importlib
import sys
import types

RENDERER, FIGURE = "matplotlib.backends.backend_agg", "matplotlib.figure"


@contextlib.contextmanager
def _no_words():
    """The text of every artist's set() is left out meanwhile: that text alone is a third of the time of the import."""
    import matplotlib.artist
    words, matplotlib.artist.kwdoc = matplotlib.artist.kwdoc, lambda artist: ""
    try:
        yield
    finally:
        matplotlib.artist.kwdoc = words


def load_renderer():
    """Load what draws lines, dots and text; figures and axes are a quarter of the time more.  Who has it loaded keeps his own."""
    if RENDERER not in sys.modules:
        with _no_words():
            importlib.import_module(RENDERER)


def load():
    """Load figures and axes too, without the three-dimensional ones; the first figure does."""
    load_renderer()
    if FIGURE in sys.modules:
        return
    empty = types.ModuleType("mpl_toolkits.mplot3d")
    empty.Axes3D = None  # how matplotlib itself says that there are none
    no_3d = sys.modules.setdefault("mpl_toolkits.mplot3d", empty) is empty
    try:
        with _no_words():
            importlib.import_module(FIGURE)
    finally:
        if no_3d:
            del sys.modules["mpl_toolkits.mplot3d"]
