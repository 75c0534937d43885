#!/usr/bin/env python3
"""Writes an analysis of steady heat conduction for CalculiX around a mesh of several bodies from
`locvol mesh -o WALL.inp`, which it includes. Sheets have temperatures, and bodies conductivities.

The case prints the temperatures of sheets that are asked for, and the heat that flows in."""
import argparse


def named(text):
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not like brick=0.8") from None


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mesh", help="WALL.inp")
    parser.add_argument("-o", "--output", required=True, help="the case, NAME.inp")
    parser.add_argument("--conductivity", type=named, nargs="+", required=True, metavar="BODY=K")
    parser.add_argument("--temperature", type=named, nargs="+", required=True, metavar="SHEET=T")
    parser.add_argument("--print", nargs="*", default=[], metavar="SHEET", dest="told")
    arguments = parser.parse_args()
    with open(arguments.output, "w", encoding="ascii") as out:
        out.write(f"*INCLUDE, INPUT={arguments.mesh}\n")
        for body, value in arguments.conductivity:
            out.write(f"*MATERIAL, NAME={body}\n*CONDUCTIVITY\n{value}\n"
                      f"*SOLID SECTION, ELSET={body}, MATERIAL={body}\n")  # fmt: skip
        out.write("*STEP\n*HEAT TRANSFER, STEADY STATE\n*BOUNDARY\n")
        for sheet, value in arguments.temperature:
            out.write(f"{sheet}, 11, 11, {value}\n")
        for sheet in arguments.told:
            out.write(f"*NODE PRINT, NSET={sheet}\nNT\n")
        for sheet, _ in arguments.temperature:
            out.write(f"*NODE PRINT, NSET={sheet}, TOTALS=ONLY\nRFL\n")
        out.write("*NODE FILE\nNT\n*END STEP\n")


if __name__ == "__main__":
    main()
