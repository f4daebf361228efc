"""An ensemble: several learners of one method, from several seeds, in one campaign.

Where one learner keeps to the first mode of failure that it finds, another seed finds another.
"""

from eigenfail_services.methods.ensemble.method import Ensemble

__all__ = ["Ensemble"]
