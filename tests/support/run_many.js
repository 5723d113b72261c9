// A plant over many sets of parameters, all numbers as doubles.  Of each set: the code, its place,
// whether a function without exact bits was asked, how far its start is from the one given, the
// state, and the outputs.  For a page, or: node run_many.js MODEL.js IN OUT
"use strict";

function runMany({ start, run }, numbers, wasAsked) {
    let place = 0;
    const take = (count) => numbers.slice(place, (place += count));
    const [sets, parameters, states, rows, inputs, outputs] = take(6);
    const times = take(rows);
    const held = take(rows * inputs);
    const results = [];
    for (let k = 0; k < sets; k++) {
        wasAsked();
        const p = take(parameters);
        const given = take(states);
        const x = start(p);
        const off = Math.max(...given.map((it, i) => (it === x[i] ? 0 : Math.abs(it - x[i]))));
        const out = new Float64Array(rows * outputs);
        const at = new Float64Array(1);
        const code = run(p, x, rows, times, held, out, Infinity, at);
        results.push(code, at[0], Number(wasAsked()), off, ...x, ...out);
    }
    return Float64Array.from(results);
}

// Watch the functions of which each engine has its own last bit; tells whether one was asked since.
function watched() {
    let asked = false;
    const names = "acos asin atan atan2 cos cosh exp expm1 log log10 log1p sin sinh tan tanh";
    for (const name of names.split(" ")) {
        const exact = Math[name];
        Math[name] = (...given) => {
            asked = true;
            return exact(...given);
        };
    }
    return () => {
        const before = asked;
        asked = false;
        return before;
    };
}

if (typeof require === "function") {
    const fs = require("fs");
    const [file, input, output] = process.argv.slice(2);
    const wasAsked = watched();
    const model = new Function("return " + fs.readFileSync(file, "utf8"))();
    const bytes = fs.readFileSync(input);
    const numbers = new Float64Array(bytes.buffer, bytes.byteOffset, bytes.length / 8);
    fs.writeFileSync(output, Buffer.from(runMany(model, numbers, wasAsked).buffer));
}
