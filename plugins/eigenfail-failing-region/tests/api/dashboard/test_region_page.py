"""The page of a failing region, and the link to it on the campaign's page."""


def test_a_region_says_why_there_is_none(check_page, campaign, deliver, result):
    deliver(campaign, result(0))
    check_page("dashboard/region/computing", f"/campaigns/{campaign}/region")
    check_page("dashboard/region/none", f"/campaigns/{campaign}/region/boxes")


def test_the_page_of_a_campaign_whose_parameters_vary_leads_to_it(http, fields):
    def has_link(**given):
        made = http.post("/api/v1/campaigns", json=fields | given).json()["id"]
        link = f'<a href="/campaigns/{made}/region">Failing region</a>'
        return link in http.get(f"/campaigns/{made}").text

    assert has_link(scenario_parameters={"distance_m": {"uniform": [52.0, 70.0]}})
    assert not has_link(scenario_parameters={"distance_m": 58.0})
