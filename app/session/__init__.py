"""The worker behind the page: commands in, states out."""
