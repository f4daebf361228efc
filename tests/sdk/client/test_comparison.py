"""Courses and comparisons, as users of the client ask for them."""

import pytest

from eigenfail.errors import InvalidValue, NotFound


def test_a_course_and_a_comparison_of_campaigns_that_have_not_begun(client, fields):
    a, b, c = (client.campaigns.create(**fields, seed=seed).id for seed in (1, 2, 3))
    course = client.campaigns.course(a)
    assert (course.campaign, course.per, course.blocks) == (a, 1, ())
    assert client.campaigns.course(a, per=7).per == 7
    assert client.campaigns.compare(a, b).b.campaigns == (b,)
    assert client.campaigns.compare([a, c], [b]).a.campaigns == (a, c)


def test_what_cannot_be_compared_is_refused(client, fields):
    made = client.campaigns.create(**fields).id
    with pytest.raises(InvalidValue, match="listed twice"):
        client.campaigns.compare(made, made)
    with pytest.raises(InvalidValue, match="none is named"):
        client.campaigns.compare([], made)
    with pytest.raises(InvalidValue):
        client.campaigns.compare(-1, made)
    with pytest.raises(NotFound):
        client.campaigns.compare(made, 99)
    with pytest.raises(NotFound):
        client.campaigns.course(99)
