"""A world to be examined in: concealed cases whose physics shares nothing with the package.

A case is a directory as a user would have it (``lab/`` recordings of one pack, ``flights/`` as tlogs) and, outside it,
an answer that says what the flights carry and the lab runs do not. A `CaseSheet` orders it, `draw_suite` draws sheets,
`generate` makes the case; every number follows from (suite, seed, index).
"""
