"""Constants of isotropic laws: what is refused, with one message for all of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.fem import Hencky, Isotropic, NeoHookean, SaintVenantKirchhoff


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"E": np.array([210e9])}, r"E; got array\(\[2\.1e\+11\]\); expected a number > 0"),
        ({"E": True}, "E; got True; expected a number > 0"),
        ({"E": "210e9"}, "E; got '210e9'; expected a number > 0"),
        ({"nu": None}, r"nu; got None; expected a number in \(-1, 0\.5\)"),
        ({"nu": 0.5}, r"nu out of range; got 0\.5; expected a number in \(-1, 0\.5\)"),
        ({"E": np.inf}, "E out of range; got inf"),
        ({"E": 10**400}, "E out of range; got inf"),
        ({"density": np.True_}, "density; got .*True.*; expected a number >= 0"),
        ({"expansion": np.inf}, "expansion out of range; got inf; expected a number$"),
        ({"expansion": [1e-5]}, r"expansion; got \[1e-05\]; expected a number$"),
    ],
)
@pytest.mark.parametrize("law", [Isotropic, SaintVenantKirchhoff, NeoHookean, Hencky])
def test_what_is_no_number_is_shown_as_it_was_given(
    law: type, change: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=f"^{law.__name__}: {words}"):
        law(**{"E": 210e9, "nu": 0.3, **change})


def test_numbers_of_numpy_are_numbers() -> None:
    found = Isotropic(np.array(210e9), np.float32(0.25), np.int64(7850))
    assert (found.E, found.nu, found.density) == (210e9, 0.25, 7850.0)
    assert all(type(value) is float for value in (found.E, found.nu, found.density))
