"""What an effect has to earn before it is called physics of a pack, in nats of evidence."""

from __future__ import annotations

NATS = 10.0  # that a member of a set has to earn against the best set without it
NEAR = 6.0  # [nats] within which two explanations cannot be told apart
# Evidence from which on the flights say which of two is likelier, odds of twenty to one, and not how common they are
# ("strong": Kass and Raftery 1995).
STRONG = 3.0
# What a model of a cell gets wrong by its structure looks like these. So they have to earn more before they are
# called physics of this pack; a skew looks like what relaxes faster than a lab samples.
STRUCTURAL = frozenset(
    {"ocv-shape", "resistance-shape", "slow-diffusion", "charge-transfer", "hysteresis", "rate-capacity", "time-skew"}
)
_STRUCTURAL_NATS = 30.0
# What stands beside another effect of temperature is what an inexact equation of that one leaves, more often than not.
COMPANIONS = frozenset({"core-lag", "entropic-voltage", "cold-capacity"})
# A course over the charge that is free at every knot follows nearly anything: only where no equation comes near it.
FREE = frozenset({"ocv-shape", "resistance-shape"})
_FREE_NATS = 60.0
# What shows for seconds: nothing that is slow, as a lab's errors are, tells its size.
BRIEF = frozenset({"time-skew", "intermittent-contact"})
# What no cell is without, by a size that is known before: where what drives it was recorded, the battery file lacks a
# law, not a thing that may have happened to the pack. That it holds needs no long odds, only that flights show it.
LAWS = frozenset({"resistance-temperature", "self-discharge"})
# Of what is asked of these, where what the structure gets wrong in the lab is known and taken off already.
_TOLD_SHARE = 0.6
_TOLD = STRUCTURAL - {"time-skew"}  # no lab sees what relaxes faster than it samples
# What shapes the drop under a load: what a model gets wrong of that at the lab's temperature is another thing where it
# is warmer or colder.
OF_DROP = frozenset({"resistance-shape", "slow-diffusion", "charge-transfer", "rate-capacity"})
LEAST_SNR = 3.0  # below, these recordings cannot show an effect of the usual size

Names = frozenset[str]


def needed(name: str, told: bool = False, alone: bool = False) -> float:
    """What a member has to earn, whether or not the lab ``told`` what its model's form is off by. [nats]

    Where it told that, only noise is left to look like structure ``alone``; beside another effect there is also what
    the equation of that one leaves, unless that says no more than what flights begin with.
    """
    if told and alone and name in _TOLD - FREE:
        return NATS
    if name in FREE:
        return share_asked(name, told) * _FREE_NATS
    return share_asked(name, told) * _STRUCTURAL_NATS if name in STRUCTURAL | COMPANIONS else NATS


def structural(told: bool) -> float:
    """What has to be earned by what looks like a model's structure, where the lab ``told`` or not what it is off by."""
    return (_TOLD_SHARE if told else 1.0) * _STRUCTURAL_NATS


def share_asked(name: str, told: bool) -> float:
    """Of what is asked of a member that looks like a model's structure, where the lab ``told`` what that is off by."""
    return _TOLD_SHARE if told and name in _TOLD else 1.0
