"""Talking to the user: options, messages, progress, and errors as one message with an exit code.

Results go to the standard output, messages about trouble to the standard error.
"""

from __future__ import annotations

import gc
import os
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Console
from rich.text import Text
from typer.core import TyperGroup

from gpusim.cli.help import FlagsWithoutType
from gpusim.errors import GpusimError
from gpusim.interrupts import INTERRUPTED, end_at_once, raise_again
from gpusim.printable import printable


def folder_name(text: str) -> Path:
    """The folder of an option; an empty name isn't the working folder."""
    if not str(text):
        raise typer.BadParameter("no name of a folder; got ''")
    return Path(text)


Backend = Literal["auto", "gpu", "numpy"]
"""Where the numbers are made."""
BackendOption = Annotated[
    Backend,
    typer.Option(help="auto: a Vulkan device, else NumPy; gpu: a device or an error; numpy: none."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
Output = Annotated[
    Path,
    typer.Option("-o", "--output", metavar="OUT", help="Output folder.", parser=folder_name),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]


@contextmanager
def starting(output: Path, backend: Backend) -> Iterator[None]:
    """Begin with what an earlier run into ``output`` has asked the device for, while the block
    reads and imports the rest."""
    if backend == "numpy":
        yield
        return
    from gpusim.gpu.warmup import compile_ahead
    from gpusim.plan.programs import earlier_programs

    with compile_ahead(earlier_programs(output)):
        yield


@contextmanager
def importing() -> Iterator[None]:
    """Without garbage collection meanwhile, nor later of what was made.

    What modules make while they are imported stays; to look through it again and again for garbage
    takes a sixth of the time that a command needs to start. Interrupts end the command meanwhile.
    """
    enabled = gc.isenabled()
    end_at_once()
    gc.disable()
    try:
        yield
    finally:
        raise_again()
        gc.freeze()
        if enabled:
            gc.enable()


@contextmanager
def waiting(reason: str) -> Iterator[None]:
    """Say on a terminal meanwhile what is waited for; "": nothing."""
    console = Console(stderr=True, highlight=False)
    if not reason or not console.is_terminal:
        yield
        return
    with console.status(reason):
        yield


def out(text: str = "") -> None:
    """One line (or several) of a result on the standard output, never wrapped."""
    sys.stdout.write(printable(text, keep="\n") + "\n")


def finish(content: str, as_json: bool, quiet: bool, show: Callable[[], None]) -> None:
    """End a command: its JSON ``content``, or what it has to ``show``, or nothing.

    Examples
    --------
    >>> from gpusim.cli.console import finish, out
    >>> finish('{"frames": 2}', False, False, lambda: out("2 frames"))
    2 frames
    """
    if as_json:
        out(content.rstrip())
    elif not quiet:
        show()


@contextmanager
def exit_codes() -> Iterator[None]:
    """End the command with the exit code of what went wrong inside, after one message.

    GPUSIM_DEBUG=1 in the environment shows the traceback too, and NumPy's warnings of numbers that
    overflow: what comes of them is checked, and ends in a message of its own.
    """
    try:
        raise_again()
        with warnings.catch_warnings():
            if not _debugging():
                warnings.simplefilter("ignore", RuntimeWarning)
                warnings.showwarning = _warn
            yield
    except typer.Exit:
        raise
    except KeyboardInterrupt:
        _complain("interrupted; what is finished will be reused by the next run")
        raise typer.Exit(INTERRUPTED) from None
    except GpusimError as error:
        _debug()
        _complain(str(error))
        raise typer.Exit(error.exit_code) from None
    except BrokenPipeError:
        # the reader has gone (`gpusim schema | head`); keep the interpreter's exit quiet too
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(1) from None
    except MemoryError:
        _debug()
        _complain("out of memory; `gpusim plan` estimates what a scene needs")
        raise typer.Exit(1) from None
    except Exception as error:
        _debug()
        if "can't start new thread" in str(error):  # CPython's word for it
            _complain("out of memory or processes: the system starts no new thread")
            raise typer.Exit(1) from None
        kind = "" if isinstance(error, OSError) else f"internal error, {type(error).__name__}: "
        _complain(f"{kind}{error} (GPUSIM_DEBUG=1 shows where)")
        raise typer.Exit(1) from None


def _debugging() -> bool:
    return os.environ.get("GPUSIM_DEBUG", "0") not in ("", "0")


def _debug() -> None:
    if _debugging():
        traceback.print_exc()


def _complain(message: str) -> None:
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    message = printable(message, keep="\n")
    console.print(Text("error: ", style="bold red") + Text(message, style="not bold"))


class PrintableGroup(FlagsWithoutType, TyperGroup):
    """Commands whose usage errors repeat what was typed, made printable."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Parse the options before the command."""
        with _printable_errors():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        """Parse what follows the command, and run it."""
        with _printable_errors():
            return super().invoke(ctx)


@contextmanager
def _printable_errors() -> Iterator[None]:
    try:
        yield
    except Exception as error:
        message = getattr(error, "message", None)
        if isinstance(message, str):
            error.message = printable(message, keep="\n")  # type: ignore[attr-defined]
        raise


def _warn(message: Warning | str, *_: Any, **__: Any) -> None:
    """One line in place of Python's, which name a line of code."""
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    console.print(Text("warning: ", style="bold yellow") + Text(str(message), style="not bold"))


class ProgressDisplay:
    """Bars on a terminal, one line per finished stage elsewhere, nothing when quiet.

    A camera's pictures from the tenth on are taken together: 10 to 19, …, 90 to 99, 100 to 199, …

    Use it as a context manager and as the pipeline's callback ``(stage, done, text)``, ``done``
    from 0 to 1.
    """

    def __init__(self, quiet: bool, stream_is_result: bool) -> None:
        console = Console(stderr=stream_is_result, highlight=False)
        self._quiet = quiet or (stream_is_result and not console.is_terminal)
        self._console = console
        self._started: dict[str, float] = {}
        self._finished: set[str] = set()
        self._tasks: dict[str, Any] = {}
        self._pictures: dict[tuple[str, int], set[int]] = {}  # series and first -> finished
        self._bars: Any = None
        if console.is_terminal and not self._quiet:
            from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
            from rich.table import Column

            class Seconds(ProgressColumn):
                """Seconds so far, or those the stage took."""

                def render(self, task: Task) -> Text:
                    spent = task.finished_time if task.finished else task.elapsed
                    return Text(f"{spent or 0.0:6.1f} s")

            # only the text gives way on a narrow terminal; it is not markup: "[output]" is a word
            narrow = Column(no_wrap=True, min_width=8)
            self._bars = Progress(
                TextColumn("{task.description}", markup=False, table_column=Column(min_width=20)),
                BarColumn(bar_width=16, table_column=Column(min_width=16)),
                Seconds(table_column=narrow),
                TextColumn(
                    "{task.fields[text]}",
                    style="dim",
                    markup=False,
                    table_column=Column(no_wrap=True, overflow="ellipsis", ratio=1),
                ),
                console=console,
                expand=True,
            )

    def __enter__(self) -> ProgressDisplay:
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end_pictures("")
        if self._bars is not None:
            self._bars.stop()

    def __call__(self, stage: str, done: float, text: str = "") -> None:
        """Show how far a stage is."""
        if self._quiet:
            return
        stage, text = printable(stage), printable(text)
        series, number = _later_picture(stage)
        if not series:
            if stage.endswith("report"):
                self._end_pictures(stage.removesuffix("report"))
            self._show(stage, done, text)
            return
        size = _decade(number)
        first = number - number % size
        finished = self._pictures.setdefault((series, first), set())
        if done >= 1.0:
            finished.add(number)
        self._show(f"{series}{first:04d}..{first + size - 1:04d}", len(finished) / size, text)

    def _end_pictures(self, place: str) -> None:
        """No more pictures come in series below ``place``."""
        for (series, first), finished in self._pictures.items():
            last = first + _decade(first) - 1
            if series.startswith(place) and 0 < len(finished) <= last - first:
                name = f"{series}{first:04d}"
                end = "" if max(finished) == first else f"..{max(finished):04d}"
                self._show(f"{name}..{last:04d}", 1.0, "", f"{name}{end}")

    def _show(self, stage: str, done: float, text: str, name: str = "") -> None:
        """``name``: what the stage turns out to be."""
        now = time.perf_counter()
        start = self._started.setdefault(stage, now)
        finished = done >= 1.0
        if self._bars is not None:
            if stage not in self._tasks:
                self._tasks[stage] = self._bars.add_task(stage, total=1.0, text=text)
            self._bars.update(
                self._tasks[stage], completed=min(done, 1.0), text=text, description=name or stage
            )
        elif finished and stage not in self._finished:
            line = f"{now - start:7.2f} s  {name or stage:<22}  {text}"
            self._console.print(line.rstrip(), markup=False, soft_wrap=True)
        if finished:
            self._finished.add(stage)


def _later_picture(stage: str) -> tuple[str, int]:
    """Series and number of a picture that isn't shown by itself; "" for other stages."""
    if "render/" in stage:
        from gpusim.report.stage_rows import SINGLE, picture_number  # not for help and plans

        picture = picture_number(stage)
        if picture is not None and picture[1] >= SINGLE:
            return picture
    return "", 0


def _decade(number: int) -> int:
    """1, 10, 100, …: the place of the number's first digit."""
    return int(10 ** (len(str(number)) - 1))


def size_text(count: int) -> str:
    """Bytes for a reader: 340 MB."""
    for unit, size in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            value = count / size
            return f"{value:.1f} {unit}" if value < 10 else f"{value:.0f} {unit}"
    return f"{count} B" if count else ""


def time_text(seconds: float) -> str:
    """Seconds for a reader: 0.4 s, 3 min, 5 h, 3 days."""
    if not seconds > 0:
        return ""
    if seconds < 10:
        return f"{seconds:.1f} s"
    for unit, size, most in (("s", 1, 120), ("min", 60, 7200), ("h", 3600, 172_800)):
        if seconds < most:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds / 86_400:.0f} days"
