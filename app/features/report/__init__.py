"""`ispom report`: run folders in, one HTML file out that needs nothing but a browser."""
