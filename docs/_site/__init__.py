"""What `conf.py` needs to build the site."""
