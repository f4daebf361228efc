"""The risk of a planner, as a service finds it."""

from eigenfail.client import Client
from eigenfail_assurance.risk.assessment import RiskAssessment
from eigenfail_assurance.risk.question import RiskQuestion


def assess_risk(client: Client, question: RiskQuestion) -> RiskAssessment:
    """Return failures per hour and per 10^6 km of a planner, from campaigns, against a target.

    Args:
        client: client of the service that has the campaigns; the plug-in is installed there, too.
        question: exposure, scenarios with their campaigns, and target; see
            `eigenfail_assurance.risk.question.read_risk_file`.

    Raises:
        NotFound: unknown campaign, or a service without the plug-in.
        InvalidValue: a campaign is named twice, or does not fit the others.
    """
    return client.link.post("/risk", RiskAssessment, question)
