"""Numbers, quantities and durations as people write them: ``8.1e7``, ``1.2 ms``, ``0:00:21``."""

from __future__ import annotations

import math

_PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}

# Units that a prefix may be put before, with the prefixes in use for them (decimal exponents: lowest, highest).
# A power such as m^2 is absent on purpose: the prefix would be raised with it.
_PREFIXABLE = {
    "s": (-9, 0),
    "m": (-9, 0),
    "m/s": (-9, 0),
    "N": (-6, 9),
    "N m": (-6, 9),
    "N/m": (-3, 9),
    "Pa": (0, 9),
    "J": (-9, 9),
    "W": (-9, 9),
    "Hz": (0, 9),
}


def compact(value: float, digits: int = 2) -> str:
    """Short text of a number to ``digits`` significant digits: ``81000000.0 -> '8.1e7'``, ``0.003 -> '3e-3'``.

    Between 0.01 and 10 000 the plain decimal form is used, without an exponent and never coarser than whole numbers
    (``412 -> '412'``). NaN and infinity give ``'nan'`` and ``'inf'``.
    """
    value = float(value)
    if not math.isfinite(value):
        return str(value)
    if value == 0.0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    if -2 <= power < 4:
        return _without_tail(f"{value:.{max(digits - 1 - power, 0)}f}")
    return f"{_without_tail(mantissa)}e{power}"


def si_scale(largest: float, unit: str) -> tuple[float, str]:
    """Factor and prefixed unit that bring a value of magnitude ``largest`` (in ``unit``) to between 1 and 1000.

    ``si_scale(2.6e-3, "m") -> (1e3, "mm")``: multiply by the factor, write the unit. Units that take no prefix
    (powers, ``kg``, dimensionless ones) come back unchanged with factor 1, and so do zero and non-finite values.
    """
    magnitude = abs(float(largest))
    if unit not in _PREFIXABLE or magnitude == 0.0 or not math.isfinite(magnitude):
        return 1.0, unit
    lowest, highest = _PREFIXABLE[unit]
    # Rounded to three digits first, so that 999.9 mm is called 1 m and not 1e+03 mm.
    power = 3 * math.floor(int(f"{magnitude:.2e}".split("e")[1]) / 3)
    power = min(max(power, lowest), highest)
    return 10.0**-power, _PREFIXES[power] + unit


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """Text of a value with its unit and SI prefix: ``quantity(1.2e-3, "s") -> '1.2 ms'``.

    A dimensionless value (``unit`` is ``""``) and one out of reach of the prefixes use :func:`compact`.
    """
    factor, prefixed = si_scale(value, unit)
    scaled = float(value) * factor
    in_reach = scaled == 0.0 or not math.isfinite(scaled) or 0.9995 <= abs(scaled) < 999.5
    if not in_reach or not unit:
        return f"{compact(scaled, digits)} {prefixed}".rstrip()
    return f"{scaled:.{digits}g} {prefixed}"


def duration(seconds: float) -> str:
    """Wall time as hours, minutes and seconds: ``duration(21) -> '0:00:21'``; ``'-:--:--'`` when it is not known."""
    if not math.isfinite(seconds) or seconds < 0.0:
        return "-:--:--"
    whole = round(seconds)
    return f"{whole // 3600}:{whole % 3600 // 60:02d}:{whole % 60:02d}"


def _without_tail(decimal: str) -> str:
    return decimal.rstrip("0").rstrip(".") if "." in decimal else decimal
