"""Replays logs of the outside world: estimators over what real receivers sent, in memory that does not grow with it."""

from twin.logreplay.choice import Choice, choose, is_built_in
from twin.logreplay.replaying import LogReplay, replay_log
from twin.logreplay.settings import ReplaySettings, read_settings

__all__ = ["Choice", "LogReplay", "ReplaySettings", "choose", "is_built_in", "read_settings", "replay_log"]
