"""Keep, map, discard or recall what is known when the world has changed (paper, section 5).

`adaptive_memory` answers the paper's question. It asks `detector` whether anything has changed,
`explanation` what has changed, and `archive` whether that world was known before.
"""
