"""Every run that there is in one table: of the session, and of the recordings folder."""
