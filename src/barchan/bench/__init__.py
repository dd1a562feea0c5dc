"""Comparing solvers over many friction problems: runs, tables, performance profiles, peers in processes of their own.

Dolan and More's performance profiles as in seed B, Figures 4.8, 4.13 and 7.24; `barchan bench solvers` is the command.
"""

from barchan.bench.campaign import Campaign, Plan, Variant, problems_of_folder, run_campaign
from barchan.bench.measurement import Measurement

__all__ = ["Campaign", "Measurement", "Plan", "Variant", "problems_of_folder", "run_campaign"]
