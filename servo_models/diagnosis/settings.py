"""What decides the verdict of a diagnosis, and how much it tries.

Numbers that only keep arithmetic sound, such as ridges, roundings and grids of trial values, stand
where they are used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from servo_models.errors import UserError
from servo_models.identification.problem import FAR_DEVIATIONS, WIDER_PRIOR


@dataclass(frozen=True)
class Settings:
    """What a diagnosis holds for enough, for sure and for the same.

    The defaults were chosen on simulated logs whose causes are known, with other seeds than those
    that are reported (docs/studies/search.md).

    Attributes:
        most_effects: effects in a fitted model.
        fits_alone: smooth effects that are fitted alone.
        fits_beside: effects that are fitted beside each of the best models.
        bases: beam width: models beside which effects are fitted, none with an effect of a better
            one, since the better of two look-alikes gains more by what both lack.
        fits_exchanged: rivals that are fitted in the place of each effect of a model.
        fit_steps: least-squares steps of a fit during search.
        fit_tolerance: cost tolerance during search.
        far_deviations: prior deviations of a fitted parameter from which a wider prior is tried.
        wider_prior: factor on that prior.
        promised_cost: cost that screening promises over that of the model without an effect, below
            which the effect is worth a fit.
        rival_cost: promised cost over that of the model itself, for an effect that may do as well.
        as_good_share: share of what a model closes that leaves noise only, which another one has to
            promise.
        enough_floors: error of blocks [noise floors] below which no effect joins a model, unless
            the tolerance is less.
        entry_gap_share: part of what re-tuned parameters leave above the noise floor [RMS] that a
            first effect has to take away.
        entry_advantage: twice the log likelihood ratio by which an effect has to predict blocks
            that it has not seen better, beyond what the best of so many trials does by chance.
        entry_probability: largest probability that so many blocks favour it by chance.
        entry_share: share of the mean square error left that an effect has to take away.
        entry_share_on_bound: that share where a bound holds it back: it may imitate another effect.
        entry_share_of_third: that share from the third effect on, and for each further sine of a
            ripple: many together imitate what is none of them.
        loss_factor_on_bound: factor on the unseen errors of a model that a bound holds back.
        bound_advantage: 2 dlogL beyond a bound from which a model is bound-limited.
        least_conditions: conditions of logs from which one is left out in turn.
        settled_over_noise: structured part of the errors over the noise, below which noise is left.
        structured_over_noise: that ratio from which a part that is surely structured matters.
        missed_gap_share: least structured part over what there was to explain.
        structured_floors: structured part [RMS, noise floors] that always matters.
        many_effects: effects in a model from which nothing may be left.
        most_left_floors: structured part [RMS, noise floors] that a verdict without an effect may
            leave.
        followed_share: error left over the standard deviation of a reading, from which the model
            does not follow it.
        locked_probability: largest probability that errors follow the command so far by chance.
        locked_over_noise: what follows it over the noise, from which it matters: noise alone passed
            both in 1 of 394 trials.
        hunting_share: share of a difference that stays at a tenth of the move, from which a
            response hunts.
        explained_share: share of what can be closed from which parameters explain a gap.
        masked_floors: movement of the outputs [RMS, noise floors] from which masked effects are
            told.
        shown_deviations: standard deviations, of noise or of the parameters together, by which an
            effect stands out.
        few_models: models that a set may hold and still say something.
        covered_probability: probability that a set holds the cause.
        temper: factor on the dispersion: what is missing favours a wrong model by more than noise.
        doubt_share: share of what a fitted model surely lacks that may favour a wrong one.
        least_gain: share of the error held out (RMS) that effects have to take away to be asserted.
        map_closed_share: share of what is left that a map of it has to close.

    Raises:
        UserError: a value that is not finite or below 0, or a count below 1.

    Example:
        >>> import servo_models as sm
        >>> found = sm.diagnose("gimbal.toml", settings=sm.Settings(most_effects=1))
    """

    most_effects: int = 5
    fits_alone: int = 10
    fits_beside: int = 4
    bases: int = 2
    fits_exchanged: int = 8
    fit_steps: int = 25
    fit_tolerance: float = 1e-4
    far_deviations: float = FAR_DEVIATIONS
    wider_prior: float = WIDER_PRIOR
    promised_cost: float = 0.95
    rival_cost: float = 1.1
    as_good_share: float = 0.5
    enough_floors: float = 1.1
    entry_gap_share: float = 0.1
    entry_advantage: float = 20.0
    entry_probability: float = 0.05
    entry_share: float = 0.02
    entry_share_on_bound: float = 0.2
    entry_share_of_third: float = 0.2
    loss_factor_on_bound: float = 1.25
    bound_advantage: float = 9.0
    least_conditions: int = 3
    settled_over_noise: float = 0.3
    structured_over_noise: float = 0.4
    missed_gap_share: float = 0.2
    structured_floors: float = 5.0
    many_effects: int = 3
    most_left_floors: float = 2.0
    followed_share: float = 0.7
    locked_probability: float = 0.02
    locked_over_noise: float = 0.25
    hunting_share: float = 0.5
    explained_share: float = 0.5
    masked_floors: float = 1.0
    shown_deviations: float = 3.0
    few_models: int = 3
    covered_probability: float = 0.95
    temper: float = 3.0
    doubt_share: float = 0.02
    least_gain: float = 0.1
    map_closed_share: float = 0.2

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.type == "int" and not (isinstance(value, int) and value >= 1):
                raise UserError(f"setting '{field.name}' is {value!r}: give a whole number from 1")
            if not (isinstance(value, (int, float)) and 0.0 <= value < math.inf):
                raise UserError(f"setting '{field.name}' is {value!r}: give a finite number from 0")

    @property
    def changed(self) -> dict[str, float]:
        """Those that are not the default, by name."""
        plain = {field.name: field.default for field in fields(self)}
        return {name: value for name, value in vars(self).items() if value != plain[name]}


DEFAULT = Settings()
