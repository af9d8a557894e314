"""From results to reports, and to the tables of README.md and docs/.

`results_file` gathers finished runs; a report is made of a `finished_suite`. What each part of a suite comes
to is a value that is made once, and handed to tables, sentences and figures: `held_out`, `by_trial`, `sweep`.
Each has a section of the report, as `claims` have, and the first part is its `head`. `report`
puts all together into `pages`; `keep` keeps them, and `kept_tables` shows them elsewhere.
"""
