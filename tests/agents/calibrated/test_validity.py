"""When what was identified of a robot ceases to hold."""

from agents.calibrated.self_calibrating import Validity, ValidityCheck

USUAL, NEAR_PX, NOISE_PX = 4.0, 1.0, 0.5
INCONSISTENT, FAR_PX = 60.0, 5.0


def test_agreement_is_valid_and_a_single_contradiction_only_a_doubt():
    check = ValidityCheck()
    innovations = [USUAL, INCONSISTENT, USUAL, INCONSISTENT, USUAL]
    judged = [check.judge(each, FAR_PX, NOISE_PX) for each in innovations]
    assert judged == [
        Validity.VALID,
        Validity.DOUBTED,
        Validity.VALID,
        Validity.DOUBTED,
        Validity.VALID,
    ]


def test_two_contradictions_in_a_row_end_it_once_the_noise_is_known():
    check = ValidityCheck()
    judged = [check.judge(INCONSISTENT, NEAR_PX, NOISE_PX) for _ in range(5)]
    assert judged == [
        Validity.DOUBTED,
        Validity.NOISE_UNKNOWN,
        Validity.INVALID,
        Validity.DOUBTED,
        Validity.INVALID,
    ]


def test_missing_again_and_again_is_a_contradiction_too_until_something_new_is_identified():
    check = ValidityCheck()
    judged = [check.judge(USUAL, FAR_PX, NOISE_PX) for _ in range(8)]
    assert judged == [Validity.VALID] * 6 + [Validity.DOUBTED, Validity.NOISE_UNKNOWN]
    check.begin()
    assert check.judge(USUAL, FAR_PX, NOISE_PX) is Validity.VALID


def test_in_noise_a_distance_is_no_miss():
    check = ValidityCheck()
    assert {check.judge(USUAL, FAR_PX, noise_px=2.0) for _ in range(20)} == {Validity.VALID}
