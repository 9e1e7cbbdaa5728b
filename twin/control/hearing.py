"""What every controller's configuration tells of whom it listens to, and what it needs to hear."""

from __future__ import annotations

from twin.config import Config
from twin.signals import Listening

TRUTH = "truth"
"""Name of whom a controller follows that sees the machine as it is."""


class ControllerConfig(Config):
    """A controller that asks nobody."""

    @property
    def listens(self) -> Listening:
        """Whom it listens to."""
        return Listening()

    @property
    def needed_columns(self) -> dict[str, tuple[str, ...]]:
        """Columns that are needed of each of them."""
        return {}


class FollowerConfig(ControllerConfig):
    """A controller that goes by the truth, or by one estimator and nothing else."""

    follows: str = TRUTH
    """Estimator that it goes by, or "truth"."""

    @property
    def goes_by(self) -> tuple[str, ...]:
        """Columns that are needed of an estimator that it follows."""
        raise NotImplementedError

    @property
    def listens(self) -> Listening:
        """Whom it listens to."""
        return Listening() if self.follows == TRUTH else Listening(estimators=(self.follows,), truth=False)

    @property
    def needed_columns(self) -> dict[str, tuple[str, ...]]:
        """Columns that are needed of the estimator."""
        return {} if self.follows == TRUTH else {self.follows: self.goes_by}
