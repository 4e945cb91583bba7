"""Campaigns: many picks, many workers, rows on disk."""

from pinproof.picks.campaign.campaign import Campaign
from pinproof.picks.campaign.result import CampaignResult

__all__ = ["Campaign", "CampaignResult"]
