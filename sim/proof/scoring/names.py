"""Names that answers, findings and scores share (design/discrepancy.md), and what no recording can tell apart."""

from __future__ import annotations

NONE, UNKNOWN = "none", "unknown"

BATTERY_EFFECTS = (
    "resistance-temperature", "self-heating", "core-lag", "entropic-voltage", "capacity-fade", "resistance-growth",
    "cold-capacity", "slow-diffusion", "charge-transfer", "hysteresis", "weak-cell", "partial-charge",
    "self-discharge", "rate-capacity", "ocv-shape", "resistance-shape", "contact-resistance", "intermittent-contact",
)  # fmt: skip
SENSOR_EFFECTS = ("unseen-load", "current-gain", "current-offset", "voltage-gain", "voltage-offset", "time-skew")
DEMAND_EFFECTS = (
    "air-density", "payload-mass", "wind-tilt", "translational-lift", "climb-power", "propulsion-efficiency",
)  # fmt: skip
EFFECTS = BATTERY_EFFECTS + SENSOR_EFFECTS + DEMAND_EFFECTS

CLASSES = (
    ("unseen-load", "current-offset"),
    ("voltage-gain", "voltage-offset"),
    ("contact-resistance", "resistance-growth"),
    ("resistance-temperature", "self-heating"),
    ("payload-mass", "propulsion-efficiency"),
)
"""Effects that the confusion matrix counts as one; whether an answer is right, each case's own answer says."""

OUTSIDE, SEVERAL = "out of catalogue", "several effects"


def class_of(effect: str) -> str:
    """The class of an effect in words."""
    return next((" / ".join(members) for members in CLASSES if effect in members), effect)


INDISTINGUISHABLE = (
    ("unseen-load", "current-offset", "the same equation; only a disarmed or unplugged reading separates them"),
    ("voltage-gain", "voltage-offset", "a pack's 21-25 V is too narrow a range (cosine 0.998)"),
    ("contact-resistance", "resistance-growth", "both add to the resistance alike when age does not vary"),
    ("current-gain", "capacity-fade", "the same where the loss went with electrode area"),
    ("resistance-temperature", "a drift with time or charge", "without a temperature channel and contrast at take-off"),
    ("resistance-temperature", "resistance-growth", "when season and age run together"),
    ("partial-charge", "self-discharge", "when all flights were stored equally long"),
    ("payload-mass", "propulsion-efficiency", "in the hover"),
    ("weak-cell", "capacity-fade, current-gain, rate-capacity", "without deep discharge or cell voltages"),
)
