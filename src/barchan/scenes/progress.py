"""What a person sees while a run goes on: a bar on a terminal, a line every tenth of the run elsewhere, or nothing.

Everything goes to standard error, so that standard output stays free for results.
"""

from __future__ import annotations

from types import TracebackType
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import rich.progress
    from rich.console import Console


class Progress(Protocol):
    """A display told about every step; used as a context manager."""

    def resume(self, frame: int, time: float) -> None:
        """The run (re)starts from a frame at simulated time `time` (s)."""

    def step(self, time: float, step: int, sweeps: int, certificate: float) -> None:
        """A step ended at simulated time `time` (s)."""

    def note(self, text: str) -> None:
        """Something else happens now, for example pictures are drawn."""

    def __enter__(self) -> Progress: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


def make_progress(name: str, end_time: float, shown: bool, unit: str = " s") -> Progress:
    """The display that fits standard error, or a silent one; `unit` stands behind times."""
    if not shown:
        return Silent()
    from rich.console import Console

    console = Console(stderr=True)
    make = Bar if console.is_terminal else Lines
    return make(name, end_time, console, unit)


class Silent:
    """No display."""

    def resume(self, frame: int, time: float) -> None:
        """Nothing."""

    def step(self, time: float, step: int, sweeps: int, certificate: float) -> None:
        """Nothing."""

    def note(self, text: str) -> None:
        """Nothing."""

    def __enter__(self) -> Silent:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None


class Lines(Silent):
    """A line every tenth of the simulated time, for logs."""

    def __init__(self, name: str, end_time: float, console: Console, unit: str) -> None:
        self._name, self._end, self._console, self._unit = name, end_time, console, unit
        self._tenths = 0

    def resume(self, frame: int, time: float) -> None:
        """Say where the run starts."""
        self._tenths = int(10.0 * time / self._end)
        self.note(f"from frame {frame}, t = {time:.4g}{self._unit} of {self._end:.4g}{self._unit}")

    def step(self, time: float, step: int, sweeps: int, certificate: float) -> None:
        """A line when another tenth is done."""
        tenths = int(10.0 * time / self._end * (1.0 + 1e-9))
        if tenths > self._tenths:
            self._tenths = tenths
            self.note(
                f"{10 * tenths:3d} %  t = {time:.4g}{self._unit}  step {step}  {sweeps} sweeps  "
                f"certificate {certificate:.1e}"
            )

    def note(self, text: str) -> None:
        """A line."""
        self._console.print(f"{self._name}: {text}", highlight=False, markup=False, soft_wrap=True)


class Bar(Silent):
    """A progress bar with simulated time, step, sweeps, certificate and remaining time."""

    def __init__(self, name: str, end_time: float, console: Console, unit: str) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        self._bar: rich.progress.Progress = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=24),
            TextColumn("{task.completed:.3f}/{task.total:.3g}" + unit),
            TextColumn("step {task.fields[step]}"),
            TextColumn("{task.fields[sweeps]} sweeps"),
            TextColumn("cert {task.fields[certificate]:.0e}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
        )
        self._task = self._bar.add_task(name, total=end_time, step=0, sweeps=0, certificate=0.0)

    def resume(self, frame: int, time: float) -> None:
        """Start the bar at the resumed time."""
        self._bar.update(self._task, completed=time)

    def step(self, time: float, step: int, sweeps: int, certificate: float) -> None:
        """Move the bar."""
        self._bar.update(self._task, completed=time, step=step, sweeps=sweeps, certificate=certificate)

    def note(self, text: str) -> None:
        """A line above the bar."""
        self._bar.console.print(text, highlight=False, markup=False)

    def __enter__(self) -> Bar:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()
