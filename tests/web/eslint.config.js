// eslint --config tests/web/eslint.config.js verefine_viz/page/web tests/web
import js from "@eslint/js";
import globals from "globals";

export default [
  { ignores: ["**/vendor/**", "**/node_modules/**"] },
  js.configs.recommended,
  {
    files: ["verefine_viz/page/web/**/*.js"],
    languageOptions: { globals: globals.browser },
    rules: { complexity: ["error", 20], "max-lines-per-function": ["error", { max: 80, skipBlankLines: true, skipComments: true }] },
  },
  { files: ["tests/web/**/*.js"], languageOptions: { globals: globals.node } },
];
