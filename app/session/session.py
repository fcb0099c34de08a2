"""One run at a time behind the page: commands in, states out. This is what other threads see of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from ispom.ensemble import build
from ispom.methods import Config, Variant
from ispom.sequences.address import without_secrets
from ispom.types import Sequence

from ..engine.events import Opened
from ..engine.external_trajectories.placed import TrajectoryOption
from ..engine.history.history import MEMORY_BYTES, History
from ..engine.history.series import Series
from ..engine.model.run_model import RunModel
from ..engine.options import SourceOptions
from ..engine.playback import Builder
from .commands import Command, Open
from .compiling import Compiling
from .controller import Controller, S, T
from .current_run import CurrentRun
from .player import Player
from .registry import load_features, services
from .sources.folders import Folders, RecentSources
from .sources.opening import SourceOpener
from .state import NoticeAdded, State
from .store import Store
from .viewers import EventSink, Viewers
from .worker import Worker


class Session:
    """`post` and `state` are for any thread, and neither ever waits."""

    def __init__(
        self,
        opener: Callable[..., Sequence],
        source: str,
        recordings_dir: Path,
        *,
        methods: tuple[str, ...] | None = None,
        variant: Variant = "modern",
        config: Config | None = None,
        live: EventSink | None = None,
        autoplay: bool = True,
        compiling: Callable[[tuple[str, ...], Config], None] = lambda *_: None,
        builder: Builder = build,
        history_bytes: int = MEMORY_BYTES,
        source_options: SourceOptions | None = None,
        folders: Folders | None = None,
        recent: RecentSources | None = None,
        trajectory_options: tuple[TrajectoryOption, ...] = (),
        compare_images: bool = False,
        extras: tuple[object, ...] = (),
        beginnings: Mapping[str, Path] | None = None,
    ) -> None:
        """`opener(source)` opens with the options of the command line, `opener(source, options)` with the page's.

        An empty `source` opens nothing: the session waits for the first command that does.
        `methods` None means all that the source has the cameras for; `compiling` begins to compile what settings
        need, when they are about to run; `builder` makes the estimators; `history_bytes` is what the frames of a run
        may take of memory; `folders` is where the page may look for sources, and `recent` keeps those that were opened;
        `trajectory_options` are trajectories of other programs; `compare_images` gives none of a stored run before
        all were compared with those that it saw; `extras` are values that features look up by type;
        `beginnings` are folders of runs over the first frames of a source, by its name, which are shown at once.
        """
        recent = recent or RecentSources(None)
        self.folders = folders or Folders()
        self.recordings_dir = recordings_dir
        load_features()
        self._store = Store(
            State(
                without_secrets(source),
                phase="opening" if source else "empty",
                config=config or Config(),
                source_options=source_options or SourceOptions(),
                recent=recent.names,
            )
        )
        self.changes = self._store.changes
        """Called, in the worker's thread, at each new state."""
        sources = SourceOpener(
            opener, builder, variant, trajectory_options, self.folders, source, beginnings or {}, compare_images
        )
        viewers = Viewers(live, lambda text: self._store.emit(NoticeAdded(text)))
        compiler = Compiling(self._store, compiling)
        self._player = Player(self._store, viewers, compiler)
        self._controller = Controller(
            self._store,
            self._player,
            viewers,
            compiler,
            opener=sources,
            first=Open(source),
            autoplay=autoplay,
            methods=methods,
            history_bytes=history_bytes,
            recent=recent,
            recordings=recordings_dir,
            extras=extras,
        )
        self._controller.add(*(kind(self._controller) for kind in services()))
        self._worker = Worker(self._controller)

    def start(self) -> None:
        self._worker.start()

    def post(self, command: Command) -> None:
        """Queues a command; what became of it shows in `state`."""
        self._worker.post(command)

    @property
    def state(self) -> State:
        return self._store.state

    @property
    def run(self) -> CurrentRun | None:
        """The run that is on the screen. Another object for each start: readers take it once, and stay with it."""
        return self._player.run

    def service(self, kind: type[S]) -> S:
        """A feature's service, whose methods are for the worker's thread unless they say otherwise."""
        return self._controller.service(kind)

    def extra(self, kind: type[T]) -> T:
        """The value of this type that the session was given, or else a new one."""
        return self._controller.extra(kind)

    @property
    def history(self) -> History:
        """Of the run that is on the screen; empty before the first."""
        return self.run.history if self.run is not None else History()

    @property
    def series(self) -> Series | None:
        """The quantities of the run that is on the screen."""
        return self.run.series if self.run is not None else None

    @property
    def opened(self) -> Opened | None:
        return self.run.opened if self.run is not None else None

    def known_at(self, index: int) -> RunModel:
        """What was known after frame `index` of the run that is on the screen."""
        return self.run.known_at(index) if self.run is not None else RunModel.start(())

    def close(self, timeout_s: float) -> bool:
        """Closes the recordings, the final trajectories included, and ends the worker.

        False where that is too busy: what was computed by then is recorded even so, within about a second more.
        """
        if self._worker.close(timeout_s):
            return True
        self._controller.close_now()
        return False
