"""`ispom loops`: every candidate of a loop, a join or a relocalisation, the rule that decided, and what if."""
