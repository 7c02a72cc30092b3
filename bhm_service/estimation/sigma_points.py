"""filterpy's sigma points and unscented transform, without the rest of filterpy.

`import filterpy` runs every filter it has, and through them scipy.stats: 45 MB and 0.4 s that an onboard service has no
use for. The two modules wanted here need none of it, so they are imported from packages whose own start-up is left
out; so is scipy.linalg, a third of the service's start: what they take of it is imported when it is called. After-
wards `import filterpy` and `import scipy.linalg` work for everybody else as if this had not happened.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

_PACKAGES = ("filterpy", "filterpy.kalman")
_UNUSED = "scipy.linalg"


class _Later(ModuleType):
    """Has every name of a module that is imported when the first of them is called."""

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def called(*args: Any, **named: Any) -> Any:
            return getattr(importlib.import_module(_UNUSED), name)(*args, **named)

        return called


def _load() -> tuple[Any, Any]:
    if "filterpy.kalman" in sys.modules:
        from filterpy.kalman import MerweScaledSigmaPoints, unscented_transform

        return MerweScaledSigmaPoints, unscented_transform
    found = importlib.util.find_spec("filterpy")
    if found is None or not found.submodule_search_locations:
        raise ImportError("filterpy is not installed")
    root = found.submodule_search_locations[0]
    linalg = sys.modules.get(_UNUSED)
    try:
        if linalg is None:
            sys.modules[_UNUSED] = _Later(_UNUSED)
        for package, path in zip(_PACKAGES, (root, f"{root}/kalman"), strict=True):
            hollow = ModuleType(package)
            hollow.__path__ = [path]
            sys.modules[package] = hollow
        points = importlib.import_module("filterpy.kalman.sigma_points")
        transform = importlib.import_module("filterpy.kalman.unscented_transform")
    finally:
        if linalg is None:
            del sys.modules[_UNUSED]
        for name in [name for name in sys.modules if name.split(".")[0] == "filterpy"]:
            del sys.modules[name]
    return points.MerweScaledSigmaPoints, transform.unscented_transform


MerweScaledSigmaPoints, unscented_transform = _load()
