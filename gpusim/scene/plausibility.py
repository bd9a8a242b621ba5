"""Numbers that no structure, material or camera has: most often a value in another unit.

They stop nothing, because somebody may mean them. ``gpusim plan`` and the report tell them.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import dist, hypot
from typing import TYPE_CHECKING

from .cost import element_sizes, extent
from .description import model as m

if TYPE_CHECKING:
    from .scene import Scene

_MODULUS = 1e5, 2e12  # Pa: soft gels to diamond
_DENSITY = 10.0, 30_000.0  # kg/m3: foams to osmium
_EXPANSION = 1e-3  # 1/K: liquids
_LARGEST, _SMALLEST, _THINNEST = 1e4, 2e-6, 1e-9  # m
_SLENDER, _ELEMENT_ASPECT = 1e5, 1e3
_FOCAL, _PIXEL, _SIDE = (5e-4, 5.0), (3e-7, 1e-3), (2e-4, 0.2)  # m
_FIELD = 1e-4, 20.0  # width of the image over its distance
_STAND_OFF = 5e-3, 1e5  # m
_AT_ORIGIN = 2e-3  # m: a place given in m where mm are meant; (0, 0, 0) is a calibration's
_GRAVITY = 1e3  # m/s2
_HEAT = 3e3  # K
_STRAIN = 0.5


def warnings(scene: Scene) -> list[str]:
    """What is implausible in a scene, one sentence each; those of its variants named by them."""
    if not scene.variants:
        return list(dict.fromkeys(_warnings(scene)))
    found: dict[str, list[str]] = {}
    for variant in scene.variants:
        for text in _warnings(scene.variant(variant.name)):
            found.setdefault(text, []).append(variant.name)
    everywhere = len(scene.variants)
    return [
        text
        if len(set(names)) == everywhere
        else f"variant {', '.join(dict.fromkeys(names))}: {text}"
        for text, names in found.items()
    ]


def _warnings(scene: Scene) -> Iterator[str]:
    for material in scene.materials:
        yield from _material(material)
    for body in scene.bodies:
        size = extent(body.mesh)
        if size is None:
            continue
        yield from size_warnings(body.name, size)
        yield from _elements(body)
        yield from _loads(body, size)
    for camera in scene.cameras:
        yield from _camera(camera)


def _material(material: m.MaterialTable) -> Iterator[str]:
    name = f"material {material.name}"
    expansions = _each(material.expansion)
    for modulus in (*_each(material.youngs_modulus), *(material.shear_modulus or ())):
        if not _MODULUS[0] <= modulus <= _MODULUS[1]:
            yield (
                f"{name}: no material has a modulus of {modulus / 1e9:g} GPa (they have "
                "1e-4 to 2000 GPa); is it in another unit? Steel has 210 GPa"
            )
            break
    if material.density and not _DENSITY[0] <= material.density <= _DENSITY[1]:
        yield (
            f"{name}: no material has a density of {material.density:g} kg/m3 (10 to 30,000 kg/m3 "
            "do); is it in another unit? Steel has 7850 kg/m3"
        )
    if not max(map(abs, expansions)) <= _EXPANSION:
        yield (
            f"{name}: expands by {max(expansions, key=abs):g} per K (solids do by less than 1e-3); "
            "steel does by 1.2e-5"
        )


def size_warnings(name: str, size: m.Vec3) -> list[str]:
    """What is implausible in the extent (m) of a body along x, y and z."""
    largest, least = max(size), min(size)
    words = " x ".join(f"{value * 1e3:.4g}" for value in size) + " mm"
    if largest > _LARGEST:
        return [f"body {name}: {words} is larger than 10 km; is its size in another unit?"]
    if largest < _SMALLEST or least < _THINNEST:
        return [
            f"body {name}: {words} is smaller than a camera sees, or than matter is continuous; "
            "is its size in another unit?"
        ]
    if largest > _SLENDER * least:
        return [
            f"body {name}: {words} is {largest / least:.2g} times as long as thick; it has "
            "hardly any stiffness, and solid elements bend it with large errors"
        ]
    return []


def _elements(body: m.Body) -> Iterator[str]:
    sizes = element_sizes(body.mesh)
    if sizes and max(sizes) > _ELEMENT_ASPECT * min(sizes):
        words = " x ".join(f"{value * 1e3:.3g}" for value in sizes)
        yield (
            f"body {body.name}: elements of {words} mm are {max(sizes) / min(sizes):.2g} times as "
            "long as thick; divisions that fit the sides are more exact"
        )


def _loads(body: m.Body, size: m.Vec3) -> Iterator[str]:
    """Loads that would strain the body by more than any linear theory holds.

    Estimates from the body's bounding box: they are low, bending strains more.
    """
    materials = [body.material, *(part.material for part in body.parts)]
    moduli = [max(_each(one.youngs_modulus)) for one in materials if one is not None]
    stiffness = max(moduli, default=0.0)
    if not stiffness > 0.0:
        return
    density = max(one.density for one in materials if one is not None)
    longest, area = max(size), sorted(size)[0] * sorted(size)[1]
    for support in body.supports:
        moved = hypot(*support.displacement) * _most(support.amplitude)
        if moved > _STRAIN * longest:
            yield (
                f"body {body.name}, support {support.name}: moves by {moved * 1e3:.3g} mm, and the "
                f"body is {longest * 1e3:.3g} mm long; linear theory is for small displacements"
            )
    for load in body.loads:
        most, stress, what = _most(load.amplitude), 0.0, ""
        if isinstance(load, m.GravityTable):
            g = hypot(*load.acceleration) * most
            if g > _GRAVITY:
                yield (
                    f"body {body.name}, load {load.name}: an acceleration of {g:g} m/s2; the "
                    "earth's is 9.81"
                )
            stress, what = density * g * longest, f"{g:.3g} m/s2"
        elif isinstance(load, m.CentrifugalTable):
            # about an axis that may be far away: the body's own length is the least radius
            stress, what = density * (load.speed * longest) ** 2 * most, f"{load.speed:.3g} rad/s"
        elif isinstance(load, m.PressureTable):
            stress, what = abs(load.pressure) * most, f"{load.pressure * most / 1e6:.3g} MPa"
        elif isinstance(load, m.TractionTable):
            stress = hypot(*load.traction) * most
            what = f"{stress / 1e6:.3g} MPa"
        elif isinstance(load, m.ThermalTable):
            change = load.temperature_change * most
            if abs(change) > _HEAT:
                yield (
                    f"body {body.name}, load {load.name}: a temperature change of {change:g} K; "
                    "no solid stands that"
                )
        else:
            force = hypot(*load.force) * most
            stress, what = force / area, f"{force:.3g} N"
        if stress > _STRAIN * stiffness:
            yield (
                f"body {body.name}, load {load.name}: {what} makes a strain of about "
                f"{100 * stress / stiffness:.2g} %; linear theory is for small strains. Is the "
                "load, or the material's stiffness, in another unit?"
            )


def _most(amplitude: m.Amplitude) -> float:
    return max(map(abs, amplitude), default=0.0)


def _each(value: float | m.Vec3) -> tuple[float, ...]:
    """Along each axis of a material, or along any."""
    return value if isinstance(value, tuple) else (value,)


def _camera(camera: m.CameraTable) -> Iterator[str]:
    name = f"camera {camera.name}"
    (width, height), (columns, rows) = camera.sensor, camera.resolution
    if width and not _SIDE[0] <= max(width, height) <= _SIDE[1]:
        yield f"{name}: a sensor of {width * 1e3:g} x {height * 1e3:g} mm; is it in another unit?"
    elif width and not _PIXEL[0] <= width / columns <= _PIXEL[1]:
        yield f"{name}: pixels of {width / columns * 1e6:.3g} um; sensors have 1 to 20 um"
    if camera.focal and not _FOCAL[0] <= camera.focal <= _FOCAL[1]:
        yield f"{name}: a focal length of {camera.focal * 1e3:g} mm; is it in another unit?"
    field = 0.0
    if camera.intrinsics:
        fx, _, cx, cy, _ = camera.intrinsics
        field = columns / fx
        if not (-columns <= cx <= 2 * columns and -rows <= cy <= 2 * rows):
            yield f"{name}: its principal point ({cx:g}, {cy:g}) px lies far outside of the image"
    elif camera.focal:
        field = width / camera.focal
    if field and not _FIELD[0] <= field <= _FIELD[1]:
        yield f"{name}: sees {field:.3g} m of width at a distance of 1 m; are its lengths right?"
    if camera.position is None:
        return
    if 0.0 < hypot(*camera.position) < _AT_ORIGIN:
        x, y, z = (1e3 * value for value in camera.position)
        yield (
            f"{name}: stands at ({x:g}, {y:g}, {z:g}) mm, in the scene's origin; is position_mm "
            "in another unit?"
        )
    if camera.target is None:
        return
    away = dist(camera.position, camera.target)
    if not _STAND_OFF[0] <= away <= _STAND_OFF[1]:
        yield (
            f"{name}: stands {away * 1e3:.4g} mm away from its target; are position_mm and "
            "target_mm in another unit?"
        )
    elif camera.focal and away <= camera.focal:
        yield (
            f"{name}: stands {away * 1e3:.4g} mm away from its target, nearer than its focal "
            f"length of {camera.focal * 1e3:g} mm: no real lens makes an image there"
        )
