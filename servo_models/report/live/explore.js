/* What a panel offers for a log of one's own: a CSV dropped on it and mapped by hand, and files to save.

Nothing is guessed here but how the text is written; names from files are only ever set as text. */
"use strict";

globalThis.servoExplorer = class {
    static LARGEST = 200e6; // bytes of a file
    static MOST_COLUMNS = 500;
    static TIMES = [
        ["s", 1],
        ["ms", 1e-3],
        ["us", 1e-6],
        ["ns", 1e-9],
    ];

    constructor(panel, make) {
        this.panel = panel;
        this.make = make;
        const pick = make("input", {
            type: "file",
            accept: ".csv,.txt,.tsv",
            "aria-label": "a CSV of your own",
            onchange: () => this.open(pick.files[0]),
        });
        this.said = make("p", { className: "live-alert", role: "alert" });
        this.mapping = make("div", {});
        this.files = make("p", { className: "live-copy" });
        this.place = make(
            "div",
            { className: "live-drop" },
            make("label", {}, "Drop a CSV here, or choose one: ", pick),
            this.said,
            this.mapping,
            this.files,
        );
        panel.place.append(this.place);
        for (const kind of ["dragenter", "dragover"])
            panel.place.addEventListener(kind, (event) => {
                event.preventDefault();
                this.place.classList.add("live-over");
            });
        panel.place.addEventListener("dragleave", () => this.place.classList.remove("live-over"));
        panel.place.addEventListener("drop", (event) => {
            event.preventDefault();
            this.place.classList.remove("live-over");
            this.open(event.dataTransfer.files[0]);
        });
        this.described(...panel.given.description);
        if (panel.given.served) new servoServed(this, make);
    }

    /* What can be saved, and the command that goes on; the file if it was dropped. */
    described(name, text, file) {
        this.given = { text, file };
        const { make } = this,
            button = (label, done) => make("button", { type: "button", onclick: done }, label);
        this.files.replaceChildren(
            button("save parameters", () => this.save("parameters.toml", this.parameters())),
            " ",
            ...(name
                ? [
                      button(`save ${name}`, () => this.save(name, text)),
                      " ",
                      make(
                          "code",
                          {},
                          `servo-models diagnose ${/^[\w.-]+$/.test(name) ? name : JSON.stringify(name)}`,
                      ),
                  ]
                : []),
        );
    }

    save(name, text) {
        const href = URL.createObjectURL(new Blob([text], { type: "text/plain" }));
        this.make("a", { href, download: name }).click();
        setTimeout(() => URL.revokeObjectURL(href), 1000);
    }

    /* The values that were moved, as a parameter file. */
    parameters() {
        const { model, values } = this.panel,
            [nominal] = Object.values(model.sets);
        const lines = [
            `actuator = ${JSON.stringify(model.actuator)}`,
            `variant = ${JSON.stringify(model.variant)}`,
            'method = "moved by hand"',
            "",
        ];
        model.parameters.forEach((it, k) => {
            if (values[k] === nominal[k]) return;
            const value = Number.isInteger(values[k]) ? `${values[k]}.0` : String(values[k]);
            lines.push(
                `[parameters.${it.name}]`,
                `value = ${value}`,
                `unit = ${JSON.stringify(it.si)}`,
                'origin = "moved by hand"',
                "",
            );
        });
        return lines.join("\n");
    }

    refuse(text) {
        this.said.textContent = text;
        this.mapping.replaceChildren();
    }

    async open(file) {
        if (!file) return;
        this.said.textContent = "";
        const told = `'${file.name}'`;
        if (file.size > servoExplorer.LARGEST) {
            return this.refuse(
                `${told} has ${Math.round(file.size / 1e6)} MB and this page reads ${servoExplorer.LARGEST / 1e6}: cut it, or use servo-models diagnose`,
            );
        }
        try {
            this.table = this.read(await file.text());
        } catch (error) {
            return this.refuse(`${told}: ${error.message}`);
        }
        this.name = file.name;
        this.file = file;
        this.map();
    }

    /* Columns of numbers of a text: names, and a Float64Array each. */
    read(text) {
        const lines = text
            .replace(/^\uFEFF/, "")
            .split(/\r\n|\n|\r/)
            .filter((line) => line.trim() && !line.startsWith("#"));
        if (text.slice(0, 4096).includes("\0"))
            throw new Error("it is no text: save the log as CSV first");
        if (lines.length < 3)
            throw new Error("it has fewer than two rows of numbers: is it a CSV?");
        const sample = lines[1],
            count = (sign) => sample.split(sign).length;
        const sign = ["\t", ";", ",", " "].find((it) => count(it) > 1) ?? ","; // a comma may be decimal
        const comma = sign === ";" || sign === "\t";
        const cells = (line) =>
            (sign === " " ? line.trim().split(/\s+/) : line.split(sign)).map((it) =>
                it.trim().replace(/^"(.*)"$/, "$1"),
            );
        const value = (cell) => (cell === "" ? NaN : Number(comma ? cell.replace(",", ".") : cell));
        const first = cells(lines[0]);
        if (first.length > servoExplorer.MOST_COLUMNS)
            throw new Error(
                `it has ${first.length} columns and this page maps ${servoExplorer.MOST_COLUMNS}: keep those of the log`,
            );
        const headless = first.every((cell) => Number.isFinite(value(cell)));
        const names = headless ? first.map((_, k) => `column ${k + 1}`) : first;
        const rows = lines.slice(headless ? 0 : 1);
        const columns = names.map(() => new Float64Array(rows.length).fill(NaN));
        rows.forEach((line, row) =>
            cells(line)
                .slice(0, names.length)
                .forEach((cell, k) => {
                    columns[k][row] = value(cell);
                }),
        );
        const numeric = columns.map(
            (column) => column.filter(Number.isFinite).length > column.length / 2,
        );
        if (numeric.filter(Boolean).length < 2)
            throw new Error("it has no two columns of numbers: a time and a signal are needed");
        return { names, columns, numeric, headless };
    }

    /* A row a signal of the model: which column, in which unit. */
    map() {
        const { make, table } = this,
            { model } = this.panel;
        const choices = () =>
            table.names.map((name, k) =>
                make("option", { value: k, disabled: !table.numeric[k] }, name),
            );
        const row = (label, units, none) => {
            const column = make(
                "select",
                { "aria-label": `column of ${label}` },
                make("option", { value: -1 }, none),
                ...choices(),
            );
            const unit = make(
                "select",
                { "aria-label": `unit of ${label}` },
                ...units.map(([name, size]) => make("option", { value: size }, name)),
            );
            return {
                column,
                unit,
                line: make(
                    "tr",
                    {},
                    make("th", { scope: "row" }, label.replaceAll("_", " ")),
                    make("td", {}, column),
                    make("td", {}, unit),
                ),
            };
        };
        this.rows = {
            time: row("time", servoExplorer.TIMES, "choose"),
            inputs: model.inputs.map((it) => [
                it,
                row(it.name, it.units, `stays at ${it.scale * it.rest} ${it.unit}`),
            ]),
            outputs: model.outputs.map((it) => [it, row(it.name, it.units, "not measured")]),
        };
        const lines = [
            this.rows.time,
            ...this.rows.inputs.map(([, it]) => it),
            ...this.rows.outputs.map(([, it]) => it),
        ];
        this.mapping.replaceChildren(
            make(
                "table",
                {},
                make("caption", {}, `What are the columns of '${this.name}'?`),
                make("tbody", {}, ...lines.map((it) => it.line)),
            ),
            make("button", { type: "button", onclick: () => this.show() }, "show"),
        );
    }

    show() {
        const { table, rows, panel } = this,
            { model } = panel,
            of = (row) => Number(row.column.value);
        const inputs = rows.inputs.filter(([, row]) => of(row) >= 0),
            outputs = rows.outputs.filter(([, row]) => of(row) >= 0);
        const wrong = (text) => {
            this.said.textContent = text;
        };
        if (of(rows.time) < 0) return wrong("choose the column of the time");
        if (!inputs.length || !outputs.length)
            return wrong("choose a column for an input and one for an output");
        const used = [rows.time, ...[...inputs, ...outputs].map(([, row]) => row)].map(
            (row) => table.columns[of(row)],
        );
        const kept = [...table.columns[0].keys()].filter((k) =>
            used.every((column) => Number.isFinite(column[k])),
        );
        const taken = (row) =>
            Float64Array.from(kept, (k) => table.columns[of(row)][k] * Number(row.unit.value));
        const stamps = taken(rows.time),
            back = stamps.findIndex((time, k) => k && time <= stamps[k - 1]);
        if (stamps.length < 3)
            return wrong("fewer than three rows have a number in all these columns");
        if (back > 0)
            return wrong(
                `the time does not rise in row ${kept[back] + (table.headless ? 1 : 2)} ('${table.names[of(rows.time)]}'): choose another column, or sort the rows`,
            );
        if (stamps.at(-1) - stamps[0] > 1e4)
            return wrong(
                `the log would last ${Math.round(stamps.at(-1) - stamps[0])} s: choose another unit of the time`,
            );
        const width = model.inputs.length,
            held = new Float64Array(width * stamps.length);
        model.inputs.forEach((it, place) => {
            const row = inputs.find(([wire]) => wire === it)?.[1],
                values = row && taken(row);
            for (let k = 0; k < stamps.length; k++)
                held[k * width + place] = values ? values[k] : it.rest;
        });
        const outside = inputs.find(([it, row]) =>
            taken(row).some(
                (value) => value < (it.low ?? -Infinity) || value > (it.high ?? Infinity),
            ),
        );
        if (outside)
            return wrong(
                `'${outside[0].name}' leaves what the model allows: choose another column or unit`,
            );
        this.said.textContent = "";
        const measured = new Map(outputs.map(([it, row]) => [it.name, taken(row)]));
        panel.add({
            name: this.name,
            begin: stamps[0],
            times: stamps.map((time) => time - stamps[0]),
            stamps,
            inputs: held,
            counted: new Float64Array(stamps.length).fill(1),
            measured,
            settle: model.duration,
            held: [held.slice(0, width)],
            placed: [],
            constants: {},
            stretches: [],
            after: {},
            note: `Before it begins, its first row is held for ${model.duration} s.`,
        });
        this.described(
            `${this.name.replace(/\.[^.]*$/, "")}.toml`,
            this.description(inputs, outputs),
            this.file,
        );
    }

    description(inputs, outputs) {
        const { table, rows } = this,
            { model } = this.panel;
        const text = JSON.stringify,
            column = (row) =>
                table.headless ? Number(row.column.value) + 1 : text(table.names[row.column.value]);
        const told = (row) =>
            `{ column = ${column(row)}, unit = ${text(row.unit.selectedOptions[0].textContent)} }`;
        return [
            `actuator = ${text(model.actuator)}`,
            `variant = ${text(model.variant)}`,
            "",
            "[[logs]]",
            `file = ${text(this.name)}`,
            `time = ${told(rows.time)}`,
            ...inputs.map(([it, row]) => `inputs.${it.name} = ${told(row)}`),
            ...outputs.map(([it, row]) => `outputs.${it.name} = ${told(row)}`),
            "",
        ].join("\n");
    }
};
