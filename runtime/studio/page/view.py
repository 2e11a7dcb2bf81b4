"""What one browser tab looks at, and how it acts: every error becomes a line on the page."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from runtime.studio.history import SessionStep
from runtime.studio.page.controls import Controls
from runtime.studio.shown import JointShown, StepShown, VerdictShown
from runtime.studio.studio import Studio


class PageView:
    """A session as one tab sees it.

    joint     the joint that is looked into, 1-based; None: the one with the largest residual over its floor
    held_out  whether its held-out recording is shown beside it
    against   the step with which the current one is compared, None: the model as given
    offered   the effect and its joint that may be tried
    tried_effect   the effect of the model whose values may be tried
    hidden_effect  the effect and its joint that may be hidden in the motion
    wrong     why the last command was refused; ""
    controls  its lists and sliders
    """

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        self.chosen: int | None = None
        self.held_out = False
        self.against: int | None = None
        self.offered: tuple[str, int | None] | None = None
        self.tried_effect: str | None = None
        self.hidden_effect: tuple[str, int | None] | None = None
        self.wrong = ""
        self.controls = Controls()
        self.changed: Callable[[], None] = lambda: None

    # --- what is there ---

    @property
    def here(self) -> SessionStep | None:
        """The step at which the session stands."""
        return self.studio.history.here

    @property
    def busy(self) -> bool:
        """Whether something is worked on."""
        work = self.studio.work
        return work is not None and work.state == "running"

    @property
    def shown(self) -> StepShown:
        """What is known of the step; there must be one."""
        assert self.here is not None
        return self.studio.shown(self.here.number)

    @property
    def verdict(self) -> VerdictShown | None:
        """Its diagnosis."""
        return None if self.here is None else self.studio.verdict(self.here.number)

    @property
    def joint(self) -> JointShown:
        """The joint that is looked into."""
        joints = self.shown["joints"]
        known = {shown["joint"]: shown for shown in joints}
        return known.get(self.chosen or 0) or max(joints, key=lambda shown: shown["floors"] or 0.0)

    # --- what is done ---

    def act(self, command: Callable[..., Any], *given: Any) -> None:
        """Do something; what is refused is said."""
        try:
            command(*given)
            self.wrong = ""
        except (ValueError, RuntimeError, OSError) as error:
            self.wrong = str(error)
        self.changed()

    def set(self, **values: Any) -> None:
        """Look at something else."""
        for name, value in values.items():
            setattr(self, name, value)
        self.changed()
