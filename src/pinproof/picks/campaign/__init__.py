"""Campaigns: many picks, many workers, rows on disk."""

from pinproof.picks.campaign.campaign import Campaign, CampaignResult

__all__ = ["Campaign", "CampaignResult"]
