"""What a certificate says is missing."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from ocptip.certificate.result import LATE, Certificate, Undecided
from ocptip.certificate.trusted.checker import Verdict
from ocptip.motion.summary import CheckedMotion

HOLDS = Verdict(True, (), {"GT": 0.5}, 3)
NONE = Verdict(False, (), {}, 0)
WITHIN = Undecided(1.25, 1.27, "contacts within tolerance", 0.021)
TIPS = Undecided(0.5, 0.6, "tip-over", 1e-3)


def test_a_complete_proof_lacks_nothing():
    assert Certificate({}, HOLDS, kept=True).missing == ""


def test_the_largest_lack_is_named_with_place_amount_and_remedy():
    lacks = Certificate({}, HOLDS, kept=True, undecided=(TIPS, WITHIN), sampled=("GN_worst_case",)).missing
    what = "a proof of foot forces and friction within the uncertainty from 1.25000 to 1.27000 s"
    assert lacks.startswith(
        f"{what}: the proved bound misses the limit by 2.1 % of the limit, sampled values keep it; and 1 more"
    )
    assert "--gt" in lacks
    assert "smaller uncertainty" in lacks
    assert "smaller uncertainty" not in Certificate({}, HOLDS, undecided=(TIPS,)).missing


@pytest.mark.parametrize(
    ("worst", "words"),
    [
        (
            {"GT_worst_case": 0.95},
            "; planning with GT_worst_case = 0.92 in [limits] may help; check that plan",
        ),
        (
            {"GT_worst_case": 0.48},
            "coarse, samples have 48 % of the friction: planning with GT_worst_case = 0.45",
        ),
    ],
)
def test_a_lack_of_friction_names_a_limit_that_much_below_the_samples(worst, words):
    assert words in Certificate({}, HOLDS, undecided=(WITHIN,), worst=worst).missing


def test_a_lack_of_margin_names_the_index_at_which_that_much_more_is_left():
    """Of GN = M0 / (M0 + M): M is larger by 0.5 M0."""
    short = replace(TIPS, short=0.5)
    lacks = Certificate({}, HOLDS, undecided=(short,), worst={"GN": 0.9}).missing
    assert lacks.endswith("; planning with --gn 0.62 may help")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"data": None, "verdict": NONE, "reason": "contacts on one line"}, "a proof: contacts on one line"),
        ({"verdict": Verdict(False, ("speed: not proved near 1 s",), {}, 3)}, "speed: not proved near 1 s"),
        ({"kept": False}, "a proof within the limits; proved is friction used <= 50.00 %"),
        ({"sampled": ("GT_stop", *LATE)}, "friction used in stops on the path, delayed joints"),
    ],
)
def test_other_lacks_have_their_reason(changes, words):
    lacks = replace(Certificate({}, HOLDS, kept=True), **changes).missing
    assert words in lacks


@pytest.mark.parametrize(
    ("claim", "short", "text"),
    [
        ("clearance", 2e-3, "clearance from 0.10000 to 0.20000 s: the proved bound misses the limit by 2 mm"),
        ("clearance within tolerance", 2e-3, "clearance within the uncertainty from 0.10000 to 0.20000 s"),
        ("torque", 1e9, "joint torques from 0.10000 to 0.20000 s, without any bound there"),
    ],
)
def test_amounts_have_the_unit_of_their_quantity(claim, short, text):
    assert str(Undecided(0.1, 0.2, claim, short)).startswith(text)


def test_of_cancels_of_a_cycle_is_claimed_what_is_proved_of_all_its_motions():
    both, one = {"GT": 0.5, "GT_cancel": 0.7}, {"GT": 0.6, "GT_cancel": 0.8, "torque_ratio_cancel": 0.4}
    parts = [Certificate({}, Verdict(True, (), bounds, 1)) for bounds in (both, one)]
    whole = parts[0].followed_by(parts[1:], [0.0, 1.0])
    assert whole.verdict.bounds == {"GT": 0.6, "GT_cancel": 0.8}


def test_proved_cancels_say_that_their_clearance_is_not_proved():
    of_cancels = {"GT": 0.5, "clearance": 0.01, "GT_cancel": 0.7}
    for bounds, said in (
        (of_cancels, True),
        ({"GT": 0.5, "clearance": 0.01}, False),
        ({"GT_cancel": 0.7}, False),
    ):
        text = str(Certificate({}, Verdict(True, (), bounds, 1), kept=True))
        assert ("clearance in cancels is not proved" in text) == said


@pytest.mark.parametrize(
    ("bounds", "kept"),
    [
        ({"GN_cancel": 0.7}, False),
        ({"GN_cancel": 0.7, "torque_ratio_cancel": 0.8}, True),
        ({"GN_cancel": 0.7, "GN_cancel_worst_case": 0.9, "torque_ratio_cancel": 0.8}, False),
        ({"GN_cancel": 0.7, "GN_cancel_worst_case": 0.9, "torque_ratio_cancel_worst_case": 0.8}, True),
    ],
)
def test_torques_in_cancels_are_proved_of_the_case_of_which_the_contacts_are(bounds, kept):
    proof = Certificate({}, Verdict(True, (), bounds, 1), kept=True, cancels=True)
    assert proof.cancel_torques == kept
    assert not replace(proof, cancels=False).cancel_torques


@pytest.mark.parametrize(
    ("bounds", "within", "words"),
    [
        ({"GN_cancel": 0.7}, None, "their clearance and torques CHECKED at samples"),
        ({"GN_cancel": 0.7, "torque_ratio_cancel": 0.8}, None, "torque limits, their clearance CHECKED at"),
        (
            {"GN_cancel_worst_case": 0.7, "torque_ratio_cancel_worst_case": 0.8},
            object(),
            "to keep torque limits (joints on time), their clearance CHECKED at samples",
        ),
    ],
)
def test_the_headline_says_of_cancels_what_is_proved_and_what_is_sampled(bounds, within, words):
    proof = Certificate({}, Verdict(True, (), bounds, 1), kept=True, cancels=True)
    check = SimpleNamespace(headline="PROVED", verified=True, within=within, objects={})
    stops = {"": SimpleNamespace(kinds="cancel", slips_alike=False)}
    motion = SimpleNamespace(check=check, certificate=proof, stops=stops, left_out=(), verified=True)
    assert words in CheckedMotion.headline.fget(motion)
