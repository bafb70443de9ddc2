"""Control the force of a press: how fast a carriage moves, and how hard its motor pushes, given the force it feels.

The carriage is velocity-driven, and its velocity follows the error of the measured contact force. This is
"damping control" (Whitney, Force feedback control of manipulator fine motions, J. Dyn. Sys. Meas. Control
99(2), 1977), the oldest form of admittance control:

    wanted velocity  w = G (F_set - f)           G: admittance, f: measured contact force
    motor force      u = f + D (w - v)           D: gain of the velocity servo, v: measured velocity

On a layer of stiffness K the carriage of mass m then obeys m z'' + D z' + (1 + a) K z = (1 + a) F_set with
1 + a = D G. D and G are chosen so that both poles lie at -rate:

    rate = sqrt((1 + a) K / m),    D = 2 m rate,    G = (1 + a) / D

So neither touch nor a step of the set point overshoots, as long as the carriage touches at a speed of at
most G F_set. With a = 1 measured force halves the mass that the layer feels; a < 0 would be positive
feedback of force, which a step longer than sqrt(m / K) makes unstable.

The controller knows the mass, and as K the layer's stiffness under the whole contact, which is the most that
it can meet: where only a part touches, the loop is slower and better damped. It is ideal otherwise: force and
velocity are measured without noise and delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_FEEDBACK = 1.0  # a above
_TOUCH = 0.25  # share of the force that is the set point at touch, and so sets the speed of touch
_DAMPED = (
    1.0  # most that the layer's damping may add to its force, as a share, by the carriage's speed in contact
)
_BRAKING = 100.0  # 1/s: most by which the speed of approach falls with the distance that is left
_BRAKING_SHARE = 1 / 8  # and as a share of the servo's rate, which must follow


@dataclass(frozen=True)
class ForceControl:
    """A controller designed for a mass (kg), a stiffness (N/m) and a force (N); see the module's docstring.

    rate: 1/s. servo: N s/m, the gain D. admittance: m/s per N, the gain G. approach_speed, contact_speed: m/s,
    the most before and after touch. touch_speed: m/s. braking: 1/s. force: N. ramp: s, from touch to the
    full set point.
    """

    mass: float
    rate: float
    servo: float
    admittance: float
    approach_speed: float
    contact_speed: float
    touch_speed: float
    braking: float
    force: float
    ramp: float

    @classmethod
    def designed(
        cls,
        mass: float,
        stiffness: float,
        *,
        force: float,
        approach_speed: float,
        ramp: float,
        dissipation: float,
    ) -> ForceControl:
        """Choose the gains.

        approach_speed: m/s, the most at which the carriage is driven. dissipation: s/m, of the layer; in
        contact the carriage is driven so slowly that damping at most doubles the layer's force.
        """
        rate = math.sqrt((1 + _FEEDBACK) * stiffness / mass)
        servo = 2 * mass * rate
        admittance = (1 + _FEEDBACK) / servo
        contact_speed = min(approach_speed, _DAMPED / dissipation) if dissipation else approach_speed
        return cls(
            mass=mass,
            rate=rate,
            servo=servo,
            admittance=admittance,
            approach_speed=approach_speed,
            contact_speed=contact_speed,
            touch_speed=min(contact_speed, _TOUCH * admittance * force),
            braking=min(_BRAKING, _BRAKING_SHARE * servo / mass),
            force=force,
            ramp=ramp,
        )

    def approach(self, distance: float, step: float) -> float:
        """Give the wanted velocity, m/s, for the next `step` s, `distance` m before the touch.

        It falls with the distance to the touch speed; over the step it is that of the step's middle.
        """
        middle = (self.touch_speed + self.braking * max(distance, 0.0)) / (1 + self.braking * step / 2)
        return min(self.approach_speed, max(middle, self.touch_speed))

    def set_point(self, elapsed: float, touch_velocity: float) -> float:
        """Give the wanted force, N, `elapsed` s after the letter touched at `touch_velocity` m/s.

        It begins where the wanted velocity is that of the touch, and rises smoothly to the whole force.
        """
        first = min(max(touch_velocity, 0.0) / self.admittance, self.force)
        share = min(elapsed / self.ramp, 1.0) if self.ramp else 1.0
        return first + (self.force - first) * share * share * (3 - 2 * share)

    def contact(self, set_point: float, measured: float) -> float:
        """Give the wanted velocity, m/s, from the wanted and the measured force, N."""
        return max(-self.contact_speed, min(self.contact_speed, self.admittance * (set_point - measured)))

    def motor_force(self, wanted: float, velocity: float, measured: float, step: float) -> float:
        """Give the motor's force, N, for the next `step` s.

        wanted, velocity: m/s. measured: contact force, N. The servo's gain is that of a sampled controller:
        without contact the velocity error falls by exp(-D step / m) exactly, at any step.
        """
        gain = self.mass * -math.expm1(-self.servo / self.mass * step) / step
        return measured + gain * (wanted - velocity)
