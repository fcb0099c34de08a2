"""What people see: the Rerun stage, the viser controls and the web page around them."""
