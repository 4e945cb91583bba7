"""The order of picks: tours, transits, lower bounds, cycle times, and the result with its report and page."""
