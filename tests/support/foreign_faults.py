"""Faults planted in FMUs of another maker, and what has to be said of each.

A fault is code of ``foreign_fmu.c``; the words follow from its size there.
"""

from __future__ import annotations

from typing import NamedTuple


class Fault(NamedTuple):
    """An FMU of ``FOREIGN``, the fault, its kind, and words of the sentence that tells it."""

    fmu: str
    fault: str
    kind: str
    told: str


FAULTS = (
    Fault("lag", "gain", "gain", "'y' has a gain of 1.01, an error of 1 %"),
    Fault("lag", "gain_small", "gain", "gain of 0.995"),
    Fault("lag", "gain_large", "gain", "gain of 1.5"),
    Fault("lag", "delay5", "delay", "'y' is 5 ms late"),
    Fault("lag", "delay1", "delay", "1 ms late"),
    Fault("lag", "delay20", "delay", "20 ms late"),
    Fault("lag", "early5", "delay", "'y'"),
    Fault("lag", "sign", "sign", "wrong sign"),
    Fault("lag", "degrees", "unit", "deg for rad"),
    Fault("lag", "milli", "unit", "1000 times as large"),
    Fault("lag", "offset", "offset", "0.01 rad too high"),
    Fault("lag", "initial", "initial state", "starts at 0.3 rad instead of 0"),
    Fault("lag", "initial_small", "initial state", "starts at 0.02 rad instead of 0"),
    Fault("lag", "drift", "drift", "drifts by 0.02 rad"),
    Fault("lag", "drift_small", "drift", "drifts by 0.006 rad"),
    Fault("lag", "noise", "noise", "is noisy"),
    Fault("lag", "noise_small", "noise", "is noisy"),
    Fault("lag", "spike", "spike", "for 1 point(s)"),
    Fault("lag", "stuck", "limits", "stays at"),
    Fault("lag", "clipped", "limits", "stays at 0.97 rad"),
    Fault("lag", "coarse", "quantiser", "differs by 0.009"),
    Fault("lag", "nan", "stops", "is no number from t = 0.701 s on"),
    Fault("lag", "refuses", "stops", "stops at t = 0.501 s"),
    Fault("lag", "per_step", "communication step", "gain of 1.004"),
    Fault("lag", "tau5", "parameter", "differs by"),
    Fault("lag", "tau2", "parameter", "differs by"),
    Fault("lag by Euler", "one_step", "communication step", "'y'"),
    Fault("lag by Euler", "delay5", "delay", "4.99 ms late"),
    Fault("lag by Euler", "gain", "gain", "gain of 1.01"),
    Fault("lag in 32 bits", "gain", "gain", "gain of 1.01"),
    Fault("lag in 32 bits", "delay5", "delay", "5 ms late"),
    Fault("lag of fixed steps", "delay5", "delay", "5 ms late"),
    Fault("oscillator", "damping", "parameter", "'position' differs by"),
    Fault("oscillator", "frequency", "parameter", "'position' differs by"),
    Fault("oscillator", "swapped", "swapped", "'position' and 'speed' are swapped"),
    Fault("oscillator", "sign", "sign", "'position' has the wrong sign"),
    Fault("oscillator", "delay5", "delay", "'position' is 5 ms late"),
    Fault(
        "oscillator, symplectic", "one_step", "communication step", "depends on the communication"
    ),
    Fault("PID with anti-windup", "windup", "parameter", "'y' differs by"),
    Fault("PID with anti-windup", "limit", "limits", "'control' starts at 1.4 instead of 1.5"),
    Fault("PID with anti-windup", "drift", "drift", "drifts by 0.06"),
    Fault("counter", "missed", "event", "misses an event, the first at t = 0.4 s"),
    Fault("counter", "twice", "event", "is 5 instead of 4 at t = 0.4 s"),
    Fault("counter", "extra", "event", "the reference has not, the first at t = 0.35 s"),
    Fault("counter", "overflow", "limits", "at t = 0.8 s"),
    Fault("counter", "late", "event", "late"),
    Fault("counter", "period", "event", "late"),
    Fault("counter", "calls", "communication step", "depends on the communication step"),
    Fault("counter of 16 bits", "missed", "event", "misses an event, the first at t = 0.4 s"),
    Fault("relay", "missed", "event", "at t = 0.835 s 65 ms late"),
    Fault("relay", "band", "parameter", "ms late"),
    Fault("relay", "glitch", "event", "2 events that the reference has not"),
    Fault("relay", "inverted", "sign", "is inverted"),
    Fault("bouncing ball", "restitution", "parameter", "'height'"),
    Fault("bouncing ball", "missed", "event", "'height' stays at 0 m"),
    Fault("bouncing ball", "gain", "gain", "gain of 1.01"),
    Fault("Van der Pol", "mu", "parameter", "'x'"),
    Fault("Van der Pol", "initial", "initial state", "'x'"),
    Fault("Van der Pol", "noise", "noise", "is noisy"),
    Fault("Van der Pol", "delay20", "delay", "'x' is 20 ms late"),
    Fault("sampled controller", "period", "event", "misses"),
    Fault("sampled controller", "held", "delay", "'control'"),
    Fault("sampled controller", "missed", "event", "'control' misses an event"),
    Fault("delay line", "calls", "communication step", "depends on the communication step"),
    Fault("delay line", "longer", "delay", "5 ms late"),
    Fault("delay line", "sign", "sign", "wrong sign"),
    Fault("string parameter", "deaf", "parameter", "differs by"),
    Fault("gears", "states", "event", "misses an event"),
    Fault("rate limiter", "slower", "limits", "gain of 0.95"),
    Fault("rate limiter", "offset", "offset", "0.01 too high"),
    Fault("motor", "current", "sign", "'current' has the wrong sign"),
    Fault("motor", "swapped", "swapped", "'angle' and 'speed' are swapped"),
    Fault("motor", "degrees", "unit", "deg for rad"),
    Fault("motor", "gain", "gain", "'angle' has a gain of 1.01"),
    Fault("heat", "celsius", "unit", "273.1 K too low"),
    Fault("heat", "gain", "gain", "gain of 1.01"),
    Fault("heat", "drift", "drift", "drifts by 0.4 K"),
    Fault("play", "narrow", "parameter", "differs by 0.01"),
    Fault("play", "delay5", "delay", "5 ms late"),
    Fault("stairs", "missed", "event", "misses 6 events"),
    Fault("stairs", "shifted", "event", "'y'"),
    Fault("pulses", "missed", "event", "misses 2 events, the first at t = 0.45 s"),
    Fault("pulses", "duty", "parameter", "ms late"),
    Fault("friction", "less", "parameter", "'slips' has its events"),
    Fault("constant", "other", "offset", "0.01 too low"),
    Fault("constant", "offset", "offset", "0.01 too high"),
)
