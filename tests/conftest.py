"""What every test shares: one device, seeded randomness, floating-point faults as errors.

Environment:

- ``GPUSIM_EXPECT_INSTALLED=1``: the session fails unless ``gpusim`` comes from site-packages.
- ``GPUSIM_EXPECT_ADAPTER=llvmpipe``: the session fails unless the device's name holds this.
- ``GPUSIM_CHECKOUT``: the checkout, where the tests run from a copy without the sources.
- ``GPUSIM_REFS``: folder of reference solutions; default ``../shared/refs`` beside the checkout.
"""

from __future__ import annotations

import gc
import os
import random
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import gpusim
from gpusim._version import __version__
from gpusim.gpu import Device, default_device
from gpusim.gpu.context import DeviceContext
from tests.support.report_figures import draw_figures

LONGEST = "test_stability_solver", "/view/"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--without-device", action="store_true", help="skip tests when they open a device"
    )


def _skip(*_: object, **__: object) -> None:
    pytest.skip("opens a device")


def pytest_sessionstart(session: pytest.Session) -> None:
    """Refuse to test something else than what was asked for."""
    os.environ["GPUSIM_NO_CACHE"] = "1"  # nothing that a test does is for later runs
    os.fsync = os.fstat  # type: ignore[assignment]  # no test sees the power fail, all would wait
    without_device = session.config.getoption("without_device")
    if without_device:
        DeviceContext.__init__ = _skip  # type: ignore[method-assign]
    package = Path(gpusim.__file__).resolve().parent
    if os.environ.get("GPUSIM_EXPECT_INSTALLED") == "1" and "site-packages" not in package.parts:
        raise pytest.UsageError(f"expected an installed gpusim, but it comes from {package}")
    expected = os.environ.get("GPUSIM_EXPECT_ADAPTER")
    if expected and not without_device:
        name = default_device().name
        if expected.lower() not in name.lower():
            raise pytest.UsageError(f"expected an adapter named like {expected!r}, got {name!r}")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that take longest first: at the end one process would wait for the other."""
    items.sort(key=lambda item: not any(name in item.nodeid for name in LONGEST))


def pytest_collectstart() -> None:
    """Until all tests are collected: a quarter of that time, and next to no garbage."""
    gc.disable()


def pytest_collection_finish() -> None:
    """What was collected stays to the end: to look through it for garbage takes time, again and
    again."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Before fixtures of a module, as those run scenes too."""
    draw_figures(item.get_closest_marker("drawn") is not None)


def pytest_report_header() -> str:
    return f"gpusim {__version__} from {Path(gpusim.__file__).parent}; {sys.executable}"


@pytest.fixture(scope="session")
def device() -> Device:
    """The device that a user gets by default; kernels are compiled once for all tests."""
    return default_device()


@pytest.fixture(scope="session")
def checkout() -> Path:
    """The folder with pyproject.toml and every committed file."""
    return Path(os.environ.get("GPUSIM_CHECKOUT") or Path(__file__).resolve().parents[1])


@pytest.fixture(scope="session")
def refs(checkout: Path) -> Path:
    """Folder of float64 reference solutions (not part of the repository)."""
    folder = Path(os.environ.get("GPUSIM_REFS") or checkout.parent / "shared" / "refs")
    if not folder.is_dir():
        pytest.skip(f"no reference solutions: set GPUSIM_REFS (looked in {folder})")
    return folder


@pytest.fixture(autouse=True)
def strict_numerics() -> Iterator[None]:
    """Same random numbers in every test and order; 0/0, 1/0 and overflow raise."""
    random.seed(20)
    np.random.seed(20)  # noqa: NPY002 - for libraries that draw from the global generator
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        yield
