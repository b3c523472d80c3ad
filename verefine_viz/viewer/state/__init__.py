"""What is open and how it is looked at: all that changes while the page is used."""
