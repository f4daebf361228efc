"""Courses and comparisons, as users of the client ask for them."""


def test_a_course_and_a_comparison_of_campaigns_that_have_not_begun(client, fields):
    a, b, c = (client.campaigns.create(**fields, seed=seed).id for seed in (1, 2, 3))
    course = client.campaigns.course(a)
    assert (course.campaign, course.per, course.blocks) == (a, 1, ())
    assert client.campaigns.course(a, per=7).per == 7
    assert client.campaigns.compare(a, b).b.campaigns == (b,)
    assert client.campaigns.compare([a, c], [b]).a.campaigns == (a, c)
