"""What a replay said, for people: tables, a series, a page, and a log that ground stations can play."""
