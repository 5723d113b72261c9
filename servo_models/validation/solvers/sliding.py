"""A mass that slides under a constant force, in closed form up to the end of a span.

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994), sec. 3; the motion
between two reversals is that of m v' = f - c v.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Sliding:
    """A mass [kg] with viscous [N s/m] and Coulomb friction [N], or the same in rotation."""

    mass: float
    viscous: float
    coulomb: float

    def after(self, x: float, v: float, force: float, time: float) -> tuple[float, float]:
        """Position and speed after ``time`` [s] under a constant ``force`` [N]."""
        while time > 0.0:
            if v == 0.0 and abs(force) <= self.coulomb:
                break
            way = math.copysign(1.0, v if v != 0.0 else force)
            rest = force - way * self.coulomb
            ends, moved = self._free(v, rest, time)
            if way * ends >= 0.0:
                return x + moved, ends
            stops = self._stop(v, rest)
            x, v, time = x + self._free(v, rest, stops)[1], 0.0, time - stops
        return x, v

    def _free(self, v: float, force: float, time: float) -> tuple[float, float]:
        """Speed after, and way in, ``time`` [s] without a reversal."""
        if self.viscous == 0.0:
            ends = v + force / self.mass * time
            return ends, 0.5 * (v + ends) * time
        slow, final = self.mass / self.viscous, force / self.viscous
        ends = final + (v - final) * math.exp(-time / slow)
        return ends, final * time + slow * (v - ends)

    def _stop(self, v: float, force: float) -> float:
        """Time [s] from speed ``v`` to standstill."""
        if self.viscous == 0.0:
            return -self.mass * v / force
        return self.mass / self.viscous * math.log1p(-self.viscous * v / force)
