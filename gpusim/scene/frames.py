"""Frames as a table: when each is, and what stands where in it.

It is made once, from the analysis and the props. What is shown is plain data: two frames of which
it is equal show the same, and a frame's results depend on no other frame's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from gpusim.scene.analyses import kind_of
from gpusim.scene.description.model import Vec3
from gpusim.scene.scene import Scene

State = tuple[float, ...]
"""What a body's motion takes to say where it is: weights of load cases, a time, …"""


class Placed(NamedTuple):
    """Where a prop is: its own point's ``position`` (m), ``rotation`` about x, y, z (rad)."""

    position: Vec3
    rotation: Vec3


class Shown(NamedTuple):
    """What stands where: per body the state of its motion (None: at rest), per prop its place
    (None: as it stands)."""

    states: tuple[State | None, ...] = ()
    places: tuple[Placed | None, ...] = ()

    @property
    def unloaded(self) -> bool:
        """Whether no body has moved, as far as the scene tells."""
        return not any(state is not None for state in self.states)

    @property
    def still(self) -> bool:
        """Whether nothing has moved."""
        return self.unloaded and not any(place is not None for place in self.places)


class Instant(NamedTuple):
    """A row of the table: the frame's ``number``, its load ``factor`` (of given displacements:
    their time), its ``time`` (s) where frames have a rate, and what is ``shown``."""

    number: int
    factor: float
    time: float | None
    shown: Shown


class FrameTable(tuple[Instant, ...]):
    """The frames of a scene, in order."""

    def shown(self, frame: int | None) -> Shown:
        """What stands where in a frame; None: before the first, unloaded."""
        if frame is not None:
            return self[frame].shown
        first = self[0].shown
        return Shown((None,) * len(first.states), (None,) * len(first.places))

    @property
    def last_moved(self) -> int:
        """The last frame in which something has moved; the last one if nothing does."""
        moved = [instant.number for instant in self if not instant.shown.still]
        return moved[-1] if moved else len(self) - 1

    def near(self, frame: int, wide: bool) -> Sequence[int]:
        """A frame, ``wide``: between its neighbours, as far as there are any."""
        if not wide:
            return (frame,)
        return sorted({max(frame - 1, 0), frame, min(frame + 1, len(self) - 1)})


def frame_table(scene: Scene, scaled: bool = True) -> FrameTable:
    """The frames of a scene; ``scaled`` as `gpusim.scene.amplitudes.load_groups` has it."""
    factors, rate = scene.analysis.frame_values, scene.analysis.frame_rate
    bodies = kind_of(scene).states(scene, scaled)
    props = [[Placed(pose.position, pose.rotation) for pose in prop.poses] for prop in scene.props]
    instants = []
    for number, factor in enumerate(factors):
        states = tuple(of_body[number] for of_body in bodies)
        places = tuple(of_prop[number] if of_prop else None for of_prop in props)
        time = None if rate is None else number / rate
        instants.append(Instant(number, factor, time, Shown(states, places)))
    return FrameTable(instants)
