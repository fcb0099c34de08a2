"""`ispom bench --page`: what the page costs who computes, how fast it answers, and what it holds."""
