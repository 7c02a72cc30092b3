"""The proof: concealed cases are sealed, a tool answers them in a process that cannot look, and the answers are opened.

`scoring/` judges: it reads answers and findings as JSON and knows neither the world that made the cases nor the tool.
"""
