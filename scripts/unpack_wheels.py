"""Unpack a folder of wheels for this interpreter, without pip: ``unpack_wheels.py WHEELS SITE``.

A wheel is an archive of what stands in site-packages. Of a package that is there for several
versions of Python, the one for this version is taken.
"""

from __future__ import annotations

import platform
import sys
import zipfile
from pathlib import Path


def fits(name: str) -> bool:
    """Whether a wheel's name says that it is for this Python and machine."""
    *_, pythons, abi, platforms = name.removesuffix(".whl").split("-")
    minor = sys.version_info[1]
    tags = pythons.split(".")
    stable = [int(tag[3:]) for tag in tags if tag.startswith("cp3") and tag[3:].isdigit()]
    right = (
        "py3" in tags
        or f"py3{minor}" in tags
        or minor in stable
        or (abi == "abi3" and any(one <= minor for one in stable))
    )
    machine = platform.machine().lower()
    return right and (platforms == "any" or platforms.lower().endswith(machine))


def unpack(folder: Path, site: Path) -> list[str]:
    """Unpack what fits; returns the names of the wheels."""
    taken = []
    for wheel in sorted(folder.glob("*.whl")):
        if not fits(wheel.name):
            continue
        with zipfile.ZipFile(wheel) as archive:
            for member in archive.namelist():
                inside = Path(member)
                if inside.is_absolute() or ".." in inside.parts:
                    raise SystemExit(f"{wheel.name}: got {member!r}, outside of its folder")
            archive.extractall(site)
        # what belongs beside everything else lies in a folder of its own
        for kind in ("purelib", "platlib"):
            for data in site.glob(f"*.data/{kind}"):
                for entry in data.iterdir():
                    entry.rename(site / entry.name)
        taken.append(wheel.name)
    return taken


if __name__ == "__main__":
    names = unpack(Path(sys.argv[1]), Path(sys.argv[2]))
    if not names:
        raise SystemExit(f"no wheel in {sys.argv[1]} is for {sys.version.split()[0]}")
    print(f"{len(names)} wheels unpacked")
