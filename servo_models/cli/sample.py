"""servo-models sample"""

from __future__ import annotations

from pathlib import Path


def sample(
    params: Path, count: int = 1000, seed: int = 0, out: Path | None = None, trust: bool = False
) -> None:
    """Draw parameter sets from an identified model; print ranges for domain randomisation.

    Values that were found only together are drawn together, and bounds are kept.

    Examples:

    servo-models sample fitted.toml

    servo-models sample fitted.toml --count 200 --out sets.csv
    """
    from servo_models.cli.console import show
    from servo_models.data.parameters import read_parameters
    from servo_models.data.samples import check_suffix
    from servo_models.data.samples import sample as draw

    if out:
        check_suffix(out)
    samples = draw(read_parameters(params, trust), count, seed)
    if out:
        samples.write(out)
    show(samples.report())
