"""An ensemble: several learners of one method, from several seeds, in one campaign.

One learner tends to stay in the first failure mode that it finds; other seeds find other modes.
"""

from eigenfail_services.methods.ensemble.method import Ensemble

__all__ = ["Ensemble"]
