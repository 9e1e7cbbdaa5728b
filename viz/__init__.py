"""Pictures of a run: the Rerun recording (.rrd), its layout, its fingerprint, and the viewer.

Only this package imports rerun and matplotlib; import it lazily.
"""

from __future__ import annotations

from viz.compose import scene_of
from viz.rrd import write_rrd
from viz.scene import Scene

__all__ = ["Scene", "scene_of", "write_rrd"]
