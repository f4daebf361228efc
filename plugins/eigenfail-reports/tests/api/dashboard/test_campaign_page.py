"""The page of a campaign offers a report on it, in three forms."""


def test_the_page_of_a_campaign_has_links_to_its_report(check_page, campaign):
    check_page("dashboard/campaign", f"/campaigns/{campaign}", "live")


def test_each_link_leads_to_a_file(http, campaign, extension):
    page = http.get(f"/campaigns/{campaign}").text
    for file in extension.campaign_files:
        address = file.address.format(campaign=campaign)
        assert address.replace("&", "&amp;") in page
        answer = http.get(address)
        assert answer.status_code == 200
        assert answer.headers["content-disposition"].startswith("attachment")
