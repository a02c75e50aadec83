"""From a session to results: the locator, its replay and its score."""
