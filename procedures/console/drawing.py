"""Figures are written to files, for which it does not matter how the environment wants them shown.

A notebook hands its backend on, as MPLBACKEND, to every program that it starts; where that backend is not installed,
matplotlib does not load.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress

BACKEND = "MPLBACKEND"


def draw_as_shipped() -> None:
    """Let the command line draw as matplotlib is shipped, whatever is set for windows and notebooks."""
    os.environ.pop(BACKEND, None)
    os.environ["MATPLOTLIBRC"] = os.devnull


def load_matplotlib() -> None:
    """Load matplotlib in a script, with the backend that the environment asks for if it is installed."""
    if "matplotlib" in sys.modules:
        return
    backend = os.environ.pop(BACKEND, None)
    import matplotlib

    if backend is not None:
        os.environ[BACKEND] = backend
        with suppress(ValueError):
            matplotlib.rcParams["backend"] = backend
