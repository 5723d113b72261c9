"""The withheld check: does the diagnosis find causes that it was not told?"""
