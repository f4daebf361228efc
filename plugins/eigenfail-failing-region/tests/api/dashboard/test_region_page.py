"""The page of a failing region, and the link to it on the campaign's page."""


def test_a_region_says_why_there_is_none(check_page, campaign, deliver, result):
    deliver(campaign, result(0))
    check_page("dashboard/region/computing", f"/campaigns/{campaign}/region")
    check_page("dashboard/region/none", f"/campaigns/{campaign}/region/boxes")


def test_the_page_of_a_campaign_leads_to_it(http, campaign):
    link = f'<a href="/campaigns/{campaign}/region">Failing region</a>'
    assert link in http.get(f"/campaigns/{campaign}").text
